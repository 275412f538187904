"""What the overview says of each command, and the examples at the end of its help."""

SHORT = {
    "demo": "A motion, its gradient beside naive ones, and a picture.",
    "scenes": "What there is to run, and its parameters.",
    "check": "Is the gradient of a scene right?",
    "compare": "Gradient methods side by side: errors, times, memory.",
    "work-precision": "Which tolerance and which solver to choose.",
    "fit": "Parameters from measurements, with their intervals.",
    "sweep": "Values and gradients at many points, to a file.",
}
"""Command -> a line of a terminal's overview."""

EXAMPLES = {
    "demo": [
        "hybridsens demo",
        "hybridsens demo cylinder-slide --output slide.pdf",
        "hybridsens demo path/to/file.py:MyScene --tolerance 1e-10",
    ],
    "scenes": [
        "hybridsens scenes",
        "hybridsens scenes pendulum-wall",
        "hybridsens scenes --json",
    ],
    "check": [
        "hybridsens check bouncing-ball",
        "hybridsens check path/to/file.py:MyScene --json",
    ],
    "compare": [
        "hybridsens compare",
        "hybridsens compare pendulum-wall --csv table.csv --output picture.svg",
    ],
    "work-precision": [
        "hybridsens work-precision pendulum-wall --solver Tsit5 --solver Dopri8",
        "hybridsens work-precision --method Replay --no-single --target 1e-8",
    ],
    "fit": [
        "hybridsens fit pendulum-wall --data angles.csv --parameters damping,wall",
        "hybridsens fit path/to/file.py:MyScene --data record.csv --sigma 0.005 \\",
        "    --parameters mass,e --guess e=0.7 --bound e=0:1 --output fit.png",
    ],
    "sweep": [
        "hybridsens sweep elastic-stop --output maps.zarr --plot maps.png \\",
        "    --vary amplitude=0.5:1.5:50 --vary frequency=1:2:50",
        "hybridsens sweep elastic-stop --output sample.nc --design sobol \\",
        "    --points 4096 --vary damping=0:0.2",
    ],
}
"""Command -> lines; one that ends in a backslash goes on in the next."""


def epilog(command: str) -> str:
    """The end of a command's help, which is not to be filled into a paragraph."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in EXAMPLES[command])
