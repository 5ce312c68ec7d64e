//! ORB features, descriptor and projection matching.
