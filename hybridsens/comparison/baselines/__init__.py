"""What one writes without this package: each a stand-in for `simulate`, to be differentiated by plain autodiff.

They take `(scene, state, *, t0, t1, ts, running_cost)` as `hybridsens.simulate` does, and each has settings of its own.
They are here to be measured, not to be used: `hybridsens.compare` puts them beside this package's gradients.
"""

from .event_chain import constant_event_time as constant_event_time
from .event_chain import events_at_root as events_at_root
from .event_chain import events_at_step_end as events_at_step_end
from .fixed_steps import where_reset as where_reset
from .fixed_steps import where_transition as where_transition
from .motion import BaselineMotion as BaselineMotion
from .penalty_contact import penalty_contact as penalty_contact
