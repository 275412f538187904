"""What else may become of a motion with contacts, and what outcomes of any motion mean there."""

from ..status import Status, add_remark, numbered, outcome


@numbered
class ContactStatus(Status):
    """How a motion of a mechanical scene ended: the outcomes of any motion, and those of contacts."""

    gap_not_smooth = outcome(
        "near the last time reached a gap jumps, or has a corner while its contact is held closed; the laws of contact "
        "say nothing of either. Write two gaps in place of a `jnp.minimum`, make the comparison of a `jnp.maximum` or "
        "`jnp.where` an event (`located_discontinuities = True`), round off the edges of a table (by a spline), and "
        "let a gap that depends on time move without a jump."
    )
    penetration = outcome(
        "the initial state penetrates a contact. It must have gap(t0, q) >= 0 in every component: a gap is positive "
        "while its contact is open, negative inside of the obstacle.",
        at_start=True,
    )
    bad_restitution = outcome("every coefficient of restitution must lie in [0, 1].")
    bad_mass_matrix = outcome(
        "the mass matrix must be symmetric positive definite at the start, at every event and at the end, and is not."
    )


add_remark(
    Status.max_events_reached,
    "In a mechanical scene whose impacts accumulate, raise `capture_speed` so that the cascade ends in sustained "
    "contact.",
)
add_remark(
    Status.event_repeats,
    "In a mechanical scene where it was an impact, a contact would stay closed: if the scene sets "
    "`sustained_contact = False`, set it to True; otherwise the laws of contact have no solution there.",
)
add_remark(
    Status.guard_jumps,
    "In a mechanical scene the load of a held contact jumps, as where the curvature of its gap does; a switch of an "
    "`AbstractSwitchedScene` marks such a place.",
)
add_remark(Status.non_finite, "In a mechanical scene the flow comes from force and mass matrix, and guards from gaps.")
add_remark(Status.bad_tolerance, "In a mechanical scene `capture_speed` must lie in [0, 1).")
