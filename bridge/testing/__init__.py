"""Side door for tests, ours and those of users: event builders and Hypothesis strategies. Nothing else imports it."""
