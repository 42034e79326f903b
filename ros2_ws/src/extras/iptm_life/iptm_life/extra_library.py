"""Names that this extra adds to the module `iptm`, with the modules that hold them."""

NAMES = {"Life": "iptm_life.life", "Usage": "iptm_life.year", "life": "iptm_life.life"}
