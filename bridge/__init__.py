"""tcbridge: events, alarms, filters, recording and replay on a Zenoh bus. The public names, nothing else."""
