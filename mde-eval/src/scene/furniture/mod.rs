//! Furniture, each piece in its own frame with its front towards -y and its foot on z = 0.

mod decor;
mod lamps;
mod seating;
mod shell;
mod storage;
mod tables;

pub(super) use decor::{coat_stand, crockery, curtain, picture, plant, radiator, rug, window};
pub(super) use lamps::{desk_lamp, floor_lamp, pendant, table_lamp};
pub(super) use seating::{bar_stool, bed, bench, chair, office_chair, sofa};
pub(super) use shell::{door, shell};
pub(super) use storage::{book_row, bookcase, cabinet, wall_shelf};
pub(super) use tables::{Top, computer, table};
