"""Methods compared in worlds that nobody chose: worlds, tables of true rollouts, sessions, summary."""
