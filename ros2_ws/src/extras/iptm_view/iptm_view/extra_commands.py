"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {
    "view": ("iptm_view.view:main", "show a run in the browser, live or from its bag"),
    "visualize": ("iptm_view.visualizer_node:main", "draw a run for RViz and Foxglove"),
}
