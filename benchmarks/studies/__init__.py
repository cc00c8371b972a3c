"""The additional studies of the paper (appendix A2.2 and A5.3), one module each: `python benchmarks/study.py NAME`."""
