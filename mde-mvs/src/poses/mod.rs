//! Poses of photographs from matches and a monocular depth prior.
