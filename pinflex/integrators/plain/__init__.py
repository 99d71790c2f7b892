"""The marches once more, short and slow, to be read and to be compared with."""
