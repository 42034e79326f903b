"""V2X bridge: the vehicle ahead and the road ahead, from messages of other cars and roadside stations.

Conventions: `time_ns` is trip time in integer nanoseconds; `now_ms` and `generated_ms` are TimestampIts in
ms, `now_ms` is the receiver's clock; `ego_position_m` is the front of the ego vehicle along its road.
Received data are untrusted: a message that cannot be used is a `Rejection`, never an exception.
"""
