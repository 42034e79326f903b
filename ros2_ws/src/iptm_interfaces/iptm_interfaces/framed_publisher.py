"""Adds the namespace of a vehicle to its frames, so that several vehicles share one graph."""

from __future__ import annotations

from typing import Any

from rclpy.publisher import Publisher

from iptm_interfaces.topics import frame_in


class FramedPublisher(Publisher):
    """A publisher that prefixes the frames of its messages.

    Codecs use the frames of the topic table only. Serialised bytes are sent unchanged: their encoder
    sets the right frame.

    Attributes:
        frame_prefix: of the vehicle, empty for none.
    """

    frame_prefix = ""

    def publish(self, msg: Any) -> None:
        """Publish a message, or its serialised bytes."""
        if self.frame_prefix and not isinstance(msg, bytes):
            header = getattr(msg, "header", None)
            if header is not None:
                header.frame_id = frame_in(self.frame_prefix, header.frame_id)
            if hasattr(msg, "child_frame_id"):
                msg.child_frame_id = frame_in(self.frame_prefix, msg.child_frame_id)
        super().publish(msg)
