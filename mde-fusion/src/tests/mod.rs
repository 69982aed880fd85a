//! Theorems and reference values, by equation.
#![allow(clippy::unwrap_used, clippy::panic)]

mod affine;
mod aggregation;
mod common;
mod fuser;
mod posterior;
mod reference;
mod robust;
