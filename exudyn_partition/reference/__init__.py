"""The full FE model under the same contact rows: the reference that errors are measured against."""

from .full_body import FullBody as FullBody
from .integrator import HHT as HHT
from .two_bodies import simulate as simulate
