"""What the processes say to each other: messages, topics, codec, and who may speak."""
