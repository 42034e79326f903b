"""Files that this extra drives in the place of the simulated vehicle, by their ending."""

from iptm_cabin.cabin_plant import plant_of
from iptm_cabin.parameters import SUFFIX

KINDS = {SUFFIX: plant_of}
