use crate::scene::stage::{Stage, Stand, enamel, lean, metal};
use crate::scene::texture::{Material, Texture, rgb};

/// Books side by side from the stand's x = 0 to `length`, on z = 0, their spines at y = 0.
pub(crate) fn book_row(stage: &mut Stage, stand: &Stand, length: f64, tallest: f64) {
    const CLOTHS: [[f64; 3]; 7] = [
        [0.62, 0.16, 0.14],
        [0.15, 0.28, 0.45],
        [0.16, 0.36, 0.24],
        [0.78, 0.68, 0.48],
        [0.22, 0.20, 0.22],
        [0.80, 0.50, 0.18],
        [0.85, 0.84, 0.80],
    ];
    let mut x = 0.0;
    loop {
        let thick = stage.between(0.016, 0.045);
        if x + thick > length {
            return;
        }
        let (high, deep) = (tallest * stage.between(0.68, 1.0), stage.between(0.13, 0.19));
        let pick = (stage.between(0.0, CLOTHS.len() as f64) as usize).min(CLOTHS.len() - 1);
        let (cloth, seed) = (stage.about(CLOTHS[pick], 0.06), stage.between(0.0, 1.0));
        let band = if pick >= 5 { rgb(0.2, 0.15, 0.1) } else { rgb(0.85, 0.75, 0.5) };
        let cover = Material::new(Texture::Spine([cloth, band], seed));
        let tilt = if seed > 0.93 { 6.0 } else { 0.0 };
        let turn = nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), f64::to_radians(tilt));
        let centre = [x + 0.5 * thick, 0.5 * deep, 0.5 * high];
        stage.tilted(stand, centre, [thick - 0.0015, deep, high], turn, cover);
        x += thick + if tilt > 0.0 { 0.03 } else { 0.0 };
    }
}

/// Shelves between two sides, with books and a few things on them.
pub(crate) fn bookcase(
    stage: &mut Stage,
    stand: &Stand,
    [width, height]: [f64; 2],
    shelves: usize,
    material: Material,
    backed: bool,
) {
    let (depth, board) = (0.28, 0.02);
    for side in [-1.0, 1.0] {
        let x = side * 0.5 * (width - board);
        stage.block(stand, [x, 0.0, 0.5 * height], [board, depth, height], material);
    }
    if backed {
        stage.block(stand, [0.0, 0.5 * depth - 0.004, 0.5 * height], [width, 0.008, height], material);
    }
    let pitch = (height - 0.06 - board) / shelves as f64;
    for k in 0..=shelves {
        let z = 0.06 + pitch * k as f64;
        stage.block(stand, [0.0, 0.0, z], [width - 2.0 * board, depth - 0.004, board], material);
        if k < shelves {
            let inner = width - 2.0 * board;
            let filled = inner * stage.between(0.45, 0.97);
            let row = stand.then(-0.5 * inner, -0.10, z + 0.5 * board);
            book_row(stage, &row, filled, 0.86 * (pitch - board));
            if inner - filled > 0.16 {
                let vase = stand.then(-0.5 * inner + filled + 0.09, 0.0, z + 0.5 * board);
                ornament(stage, &vase, 0.6 * (pitch - board));
            }
        }
    }
}

fn ornament(stage: &mut Stage, stand: &Stand, height: f64) {
    let tone = stage.about([0.5, 0.55, 0.55], 0.35);
    let glaze = Material::new(Texture::Speckle([tone, tone * 0.4], 0.006)).gloss(0.3);
    if stage.between(0.0, 1.0) < 0.5 {
        let r = 0.28 * height;
        stage.ball(stand, [0.0, 0.0, r], r.min(0.06), glaze);
        stage.cone(stand, [0.0, 0.0, r], [0.0, 0.0, height], [0.02, 0.03], glaze);
    } else {
        stage.cone(stand, [0.0, 0.0, 0.0], [0.0, 0.0, height], [0.03, 0.05], glaze);
    }
}

/// One board on two thin brackets; the wall is the stand's plane y = 0 and the board lies on z = 0.
pub(crate) fn wall_shelf(stage: &mut Stage, stand: &Stand, width: f64, material: Material) {
    let (depth, black) = (0.2, metal(0.15));
    stage.block(stand, [0.0, -0.5 * depth, -0.009], [width, depth, 0.018], material);
    for side in [-1.0, 1.0] {
        let x = side * (0.5 * width - 0.12);
        stage.rod(stand, [x, -0.006, -0.02], [x, -0.006, -0.16], 0.005, black);
        stage.rod(stand, [x, -0.006, -0.16], [x, -depth + 0.03, -0.022], 0.005, black);
    }
    let filled = width * stage.between(0.4, 0.62);
    book_row(stage, &stand.then(-0.5 * width + 0.02, -depth + 0.03, 0.0), filled, 0.24);
    for k in 0..2 {
        let x = -0.5 * width + filled + 0.12 + 0.16 * f64::from(k);
        if x < 0.5 * width - 0.06 {
            ornament(stage, &stand.then(x, -0.5 * depth, 0.0), 0.16);
        }
    }
}

/// A cupboard with fronts in `columns` and `rows`, each with a bar handle; its back is the plane y = 0.
pub(crate) fn cabinet(
    stage: &mut Stage,
    stand: &Stand,
    [width, depth, height]: [f64; 3],
    [columns, rows]: [usize; 2],
    material: Material,
) {
    let body = enamel(0.2, 0.19, 0.18);
    stage.block(stand, [0.0, -0.5 * depth, 0.5 * height], [width, depth - 0.02, height], body);
    let (wide, tall) = (width / columns as f64, height / rows as f64);
    let handle = metal(0.6);
    for column in 0..columns {
        for row in 0..rows {
            let (x, z) = (wide * (column as f64 + 0.5) - 0.5 * width, tall * (row as f64 + 0.5));
            stage.tilted(stand, [x, -depth, z], [wide - 0.006, 0.02, tall - 0.006], lean(0.0, 0.0), material);
            let (y, reach) = (-depth - 0.035, 0.3 * wide.min(tall));
            // Drawers are wide and carry their bar across, doors are tall and carry it upright.
            let bar = if wide > tall {
                [[x - reach, y, z + 0.25 * tall], [x + reach, y, z + 0.25 * tall]]
            } else {
                let side = if column % 2 == 0 { 0.4 } else { -0.4 };
                [[x + side * wide, y, z - reach], [x + side * wide, y, z + reach]]
            };
            stage.rod(stand, bar[0], bar[1], 0.006, handle);
            for end in bar {
                stage.rod(stand, end, [end[0], -depth, end[2]], 0.005, handle);
            }
        }
    }
}
