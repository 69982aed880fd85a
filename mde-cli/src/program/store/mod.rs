//! Folders that are written whole, and finished work that is found again.

pub(crate) mod contents;
pub(crate) mod folder;
pub(crate) mod lock;
