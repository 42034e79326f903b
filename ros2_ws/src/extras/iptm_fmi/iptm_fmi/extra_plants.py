"""Files that this extra drives in the place of the simulated vehicle, by their ending."""

from iptm_fmi.foreign_plant import plant_of

KINDS = {".fmu": plant_of}
