"""How a motion ended. Every message says what to do."""

import equinox as eqx


class Status(eqx.Enumeration):
    """Outcome of a run; `Status[status]` is its message."""

    successful = ""
    running = "the motion has not reached its end (this is a state inside the loop, not an outcome)."
    max_events_reached = (
        "the motion had more events than `max_events`. Raise `max_events`; or, if impacts accumulate, raise "
        "`capture_speed` so that the cascade ends in sustained contact."
    )
    max_steps_reached = (
        "the motion needed more steps than `max_steps`. Raise `max_steps`, loosen `rtol` and `atol`, or use an "
        "implicit solver if the forces are stiff."
    )
    step_size_underflow = (
        "the step size fell below the resolution of time. The forces may be stiff or singular near the last time "
        "reached; `rtol` and `atol` may be too tight for the floating point type."
    )
    gap_not_smooth = (
        "near the last time reached a gap jumps, or has a corner while its contact is held closed; the laws of contact "
        "say nothing of either. Write two gaps in place of a `jnp.minimum`, round off the edge of a `jnp.maximum` or "
        "of a table (by `jnp.logaddexp`, or a spline), and let a gap that depends on time move without a jump."
    )
    non_finite = (
        "a state, a force, or a gap or its rate is not finite. Look at the force, mass matrix, gap and running cost, "
        "and at their derivatives, at the last time reached (the derivative of `jnp.where` is nan where that of the "
        "branch that was not taken is)."
    )
    grazing = (
        "the motion reached its end, but touched or missed a contact so narrowly that the tolerances cannot tell "
        "which. Values are right to the order of its speed; derivatives are not (at grazing they do not exist). "
        "Tighten `rtol` and `atol`, leave this parameter value out, or accept it with `throw=False`."
    )
    event_repeats = (
        "an event happened again at the instant at which it had just happened, and would for ever. A contact would "
        "stay closed: if the scene sets `sustained_contact = False`, set it to True; otherwise the laws of contact "
        "have no solution there. Switches chatter: set their thresholds apart, or give the system a mode that slides."
    )
    scheduled_time_moves = (
        "a scheduled time changes between events, so it is not known before it comes. Make it from parameters, the "
        "mode and parts of the state whose flow is 0; for a time that depends on the rest write a guard."
    )
    queue_full = "more delayed events were waiting at once than the `DelayQueue` has places. Make it larger."
    penetration = "the initial state penetrates a contact. It must have gap(t0, q) >= 0 in every component."
    bad_horizon = "the end of the horizon must be later than its start, t1 > t0, and both must be finite."
    unsorted_times = "`ts` must be sorted in increasing order and lie within [t0, t1]."
    bad_restitution = "every coefficient of restitution must lie in [0, 1]."
    bad_mass_matrix = "the mass matrix must be symmetric positive definite at the start and at every event, and is not."
    bad_tolerance = "`rtol` and `atol` must be positive and finite, and `capture_speed` must lie in [0, 1)."
