"""Views from elsewhere: other targets and arms, poses in any convention, mispaired views, lenses other than stated.

No session, lab or device imports it (`pyproject.toml`).
"""
