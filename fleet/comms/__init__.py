"""How the processes talk: messages, keys, codec, stations and the two buses."""
