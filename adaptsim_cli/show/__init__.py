"""Pages drawn from stored sessions: report, comparison, index, live page, first look."""
