//! Recording of a run: MCAP channels, the report, its pictures and its page.
