"""A session: what is asked, done and stored for every trial and iteration."""
