"""Which events somebody wants: one tree, three spellings that build it, three back ends that read it."""
