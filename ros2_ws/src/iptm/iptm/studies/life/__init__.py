"""Capacity of a battery over years of use: trips in the closed loop, parking, charging, and ageing laws."""
