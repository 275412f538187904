"""Other ways to get a gradient through impacts, each written as its users would, for comparison.

Every module offers `available()`, which says why it cannot run here or returns `None`, and a `main()` that
prints value error, gradient error and time per gradient of its problems. Run one with
`python -m benchmarks.peers.diffrax_chain` from the root of the repository.
"""
