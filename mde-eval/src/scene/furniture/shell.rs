use crate::scene::stage::{Stage, Stand, enamel, metal};
use crate::scene::texture::Material;

/// Floor, walls and ceiling of a room: x from -width/2 to width/2, y from `front` (behind the camera) to `depth`.
pub(crate) fn shell(
    stage: &mut Stage,
    [width, front, depth, height]: [f64; 4],
    [floor, walls, back, ceiling]: [Material; 4],
) {
    const THICKNESS: f64 = 0.1;
    let (length, middle) = (depth - front, 0.5 * (depth + front));
    let (wide, long) = (width + 2.0 * THICKNESS, length + 2.0 * THICKNESS);
    let (half, outer) = (0.5 * THICKNESS, 0.5 * (width + THICKNESS));
    let origin = Stand::at(0.0, 0.0, 0.0);
    stage.block(&origin, [0.0, middle, -half], [wide, long, THICKNESS], floor.shadowless());
    stage.block(&origin, [0.0, middle, height + half], [wide, long, THICKNESS], ceiling.shadowless());
    for (x, y, size, material) in [
        (-outer, middle, [THICKNESS, long], walls),
        (outer, middle, [THICKNESS, long], walls),
        (0.0, front - half, [wide, THICKNESS], walls),
        (0.0, depth + half, [wide, THICKNESS], back),
    ] {
        stage.block(&origin, [x, y, 0.5 * height], [size[0], size[1], height], material.shadowless());
    }
    let skirting = enamel(0.88, 0.87, 0.84);
    for side in [-1.0, 1.0] {
        let x = side * (0.5 * width - 0.008);
        stage.block(&origin, [x, middle, 0.045], [0.016, length, 0.09], skirting);
    }
    stage.block(&origin, [0.0, depth - 0.008, 0.045], [width, 0.016, 0.09], skirting);
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
