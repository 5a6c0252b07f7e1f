"""Error against run time: every ladder of models measured alike (`padgen study`)."""

from padgen.study.run import ExtremeStudy, Study, parse_only, parse_tolerance, run_extreme, run_study

__all__ = ["ExtremeStudy", "Study", "parse_only", "parse_tolerance", "run_extreme", "run_study"]
