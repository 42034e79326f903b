"""The other end of the link: a drive as the messages that its car would have sent."""
