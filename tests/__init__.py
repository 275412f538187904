"""Tests, in folders that mirror the package, and the problems that benchmarks use too."""
