"""Ready-made scenes, by the names that the command line uses."""

from .balls_in_box import BallsInBox as BallsInBox
from .bouncing_ball import BouncingBall as BouncingBall
from .chain_of_masses import ChainOfMasses as ChainOfMasses
from .cylinder_slide import CylinderSlide as CylinderSlide
from .double_pendulum_wall import DoublePendulumWall as DoublePendulumWall
from .elastic_stop import ElasticStop as ElasticStop
from .footed_block import FootedBlock as FootedBlock
from .link_pendulum import LinkPendulum as LinkPendulum
from .newtons_cradle import NewtonsCradle as NewtonsCradle
from .pendulum_wall import PendulumWall as PendulumWall
from .shipped import ShippedScene as ShippedScene
from .stacked_balls import StackedBalls as StackedBalls
from .vibrating_table import VibratingTable as VibratingTable

SCENES: dict[str, type[ShippedScene]] = {
    "elastic-stop": ElasticStop,
    "bouncing-ball": BouncingBall,
    "cylinder-slide": CylinderSlide,
    "stacked-balls": StackedBalls,
    "vibrating-table": VibratingTable,
    "pendulum-wall": PendulumWall,
    "double-pendulum-wall": DoublePendulumWall,
}
"""Name on the command line -> class; the first is the default. Scenes of any size, `ChainOfMasses(n)` and the like, are
made in Python."""
