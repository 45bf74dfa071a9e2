//! Palm poses from the TSDF surface, ranked by quasi-static closing and wrench margin.
