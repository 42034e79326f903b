"""Capacity loss over years of use: `iptm.life`."""
