"""What the nodes share: the topic table, the codecs and the support for thin nodes."""
