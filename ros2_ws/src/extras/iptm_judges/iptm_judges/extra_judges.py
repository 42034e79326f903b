"""The judges of this extra, as the suite finds them."""

JUDGES = {
    "blast": "iptm_judges.blast_lite:judges",
    "pybamm": "iptm_judges.pybamm_cell:judges",
    "pybamm_charged": "iptm_judges.pybamm_cell:charged_judges",
}
