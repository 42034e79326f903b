"""The ego in simulated traffic (SUMO): corridor, vehicles as stations that send messages, closed loop."""
