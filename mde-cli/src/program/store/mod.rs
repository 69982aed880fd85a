//! Folders that are written whole, and finished work that is found again.

mod entry;
mod folder;
pub(crate) mod lock;

pub(crate) use entry::Entry;
pub(crate) use folder::*;
