use serde::Serialize;
use std::fmt;

/// The rooms there are, shown as `study`, `living-room` and so on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Room {
    /// A desk with a chair, a lamp on a thin pole, bookcase and wall shelves.
    Study,
    /// A sofa, coffee table, floor lamp, window with curtains.
    LivingRoom,
    /// Cupboards, a breakfast table with chairs and stools, hanging lamps.
    Kitchen,
    /// A long corridor with doors, radiator, bench and coat stand.
    Corridor,
    /// A bench under a board of tools, a ladder, planks on trestles, steel shelves with boxes.
    Workshop,
    /// Two desks with screens, swivel chairs, blinds and cabinets.
    Office,
    /// A bed with a barred headboard, wardrobe, bedside lamps.
    Bedroom,
}

impl Room {
    /// All rooms.
    pub const ALL: [Self; 7] = [
        Self::Study,
        Self::LivingRoom,
        Self::Kitchen,
        Self::Corridor,
        Self::Workshop,
        Self::Office,
        Self::Bedroom,
    ];
}

impl fmt::Display for Room {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}
