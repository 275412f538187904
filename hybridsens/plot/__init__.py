"""Pictures of motions, contacts, gradients and costates, and moving ones."""

from .animation import Animation as Animation
from .animation import animate as animate
from .contacts import contact_forces as contact_forces
from .contacts import plot_contacts as plot_contacts
from .derivatives import costate as costate
from .derivatives import plot_costate as plot_costate
from .derivatives import plot_gradients as plot_gradients
from .fan import plot_fan as plot_fan
from .motion import plot_coordinates as plot_coordinates
from .motion import plot_trajectory as plot_trajectory
from .path import plot_path as plot_path
from .path import plot_phase as plot_phase
from .solution import plot_solution as plot_solution
