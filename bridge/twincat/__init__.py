"""Side door: the spellings of a PLC program for what the rest of the package does. Nobody inside enters it."""
