//! The rooms: what stands where.

mod bedroom;
mod corridor;
mod kitchen;
mod living;
mod office;
mod setting;
mod study;
mod workshop;

use super::room::Room;
use super::stage::Stage;
use setting::Setting;

pub(super) fn furnish(room: Room, seed: u64) -> Setting {
    let stage = Stage::new(seed, room.name());
    match room {
        Room::Study => study::furnish(stage),
        Room::LivingRoom => living::furnish(stage),
        Room::Kitchen => kitchen::furnish(stage),
        Room::Corridor => corridor::furnish(stage),
        Room::Workshop => workshop::furnish(stage),
        Room::Office => office::furnish(stage),
        Room::Bedroom => bedroom::furnish(stage),
    }
}
