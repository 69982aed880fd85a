//! Folders that are written whole, and finished work that is found again.

pub(crate) mod entry;
pub(crate) mod folder;
pub(crate) mod lock;
