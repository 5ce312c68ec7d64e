//! RGB-D data sets, stamp association and trajectory files.
