"""Orbit, attitude, Sun and Earth: heat flux on each face, eclipses, orbit phase.

Imports: errors, scenario.
"""

from ._time import as_datetime, seconds_later, timespan
from .attitude import attitude_names
from .eclipse import shadow_edges, sunlit_share
from .edges import sample_times, slew_edges, sun_edges
from .faces import RINGS
from .fluxes import face_fluxes
from .geometry import orbit_phase
from .orbit import orbital_period
