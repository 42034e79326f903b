"""Signatures, messages of roadside stations and captures of traffic for the V2X bridge."""
