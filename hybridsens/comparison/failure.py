"""Why a method failed, in one line of a table."""

LONGEST = 120


def reason(error: Exception) -> str:
    """Type and first line of an error's message, at most `LONGEST` characters of it."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    message = lines[0] if lines else "no message"
    shown = message if len(message) <= LONGEST else message[: LONGEST - 3] + "..."
    return f"{type(error).__name__}: {shown}"
