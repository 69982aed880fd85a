use crate::scene::stage::{Stage, Stand, enamel, metal};
use crate::scene::texture::Material;

/// Size and surfaces of a room: x from -width/2 to width/2, y from `front` (behind the camera) to `depth`.
pub(crate) struct Shell {
    pub(crate) width: f64,
    pub(crate) front: f64,
    pub(crate) depth: f64,
    pub(crate) height: f64,
    pub(crate) floor: Material,
    pub(crate) walls: Material,
    pub(crate) back: Material,
    pub(crate) ceiling: Material,
}

const THICKNESS: f64 = 0.1;

impl Shell {
    pub(crate) fn build(self, stage: &mut Stage) {
        let (length, middle) = (self.depth - self.front, 0.5 * (self.depth + self.front));
        let (wide, long) = (self.width + 2.0 * THICKNESS, length + 2.0 * THICKNESS);
        let (half, outer) = (0.5 * THICKNESS, 0.5 * (self.width + THICKNESS));
        let origin = Stand::at(0.0, 0.0, 0.0);
        stage.block(&origin, [0.0, middle, -half], [wide, long, THICKNESS], self.floor.shadowless());
        let ceiling = self.ceiling.shadowless();
        stage.block(&origin, [0.0, middle, self.height + half], [wide, long, THICKNESS], ceiling);
        for (x, y, size, material) in [
            (-outer, middle, [THICKNESS, long], self.walls),
            (outer, middle, [THICKNESS, long], self.walls),
            (0.0, self.front - half, [wide, THICKNESS], self.walls),
            (0.0, self.depth + half, [wide, THICKNESS], self.back),
        ] {
            let size = [size[0], size[1], self.height];
            stage.block(&origin, [x, y, 0.5 * self.height], size, material.shadowless());
        }
        let skirting = enamel(0.88, 0.87, 0.84);
        for side in [-1.0, 1.0] {
            let x = side * (0.5 * self.width - 0.008);
            stage.block(&origin, [x, middle, 0.045], [0.016, length, 0.09], skirting);
        }
        stage.block(&origin, [0.0, self.depth - 0.008, 0.045], [self.width, 0.016, 0.09], skirting);
    }
}

/// A panelled door with its frame and handle; the wall is the plane y = 0 of the stand.
pub(crate) fn door(stage: &mut Stage, stand: &Stand, leaf: Material, frame: Material) {
    let (width, height) = (0.82, 2.03);
    stage.block(stand, [0.0, -0.015, 0.5 * height], [width, 0.03, height], leaf);
    for side in [-1.0, 1.0] {
        let x = side * (0.5 * width + 0.035);
        stage.block(stand, [x, -0.025, 0.5 * height + 0.03], [0.07, 0.05, height + 0.06], frame);
        for (z, tall) in [(0.5, 0.7), (1.42, 0.9)] {
            stage.block(stand, [side * 0.19, -0.034, z], [0.27, 0.01, tall], leaf);
        }
    }
    stage.block(stand, [0.0, -0.025, height + 0.035], [width, 0.05, 0.07], frame);
    let brass = metal(0.7);
    stage.rod(stand, [0.33, -0.03, 1.02], [0.33, -0.08, 1.02], 0.009, brass);
    stage.rod(stand, [0.335, -0.08, 1.02], [0.22, -0.08, 1.02], 0.008, brass);
}
