use super::*;

pub(super) fn furnish(s: &mut Stage) -> Setting {
    let (width, depth, height) = (4.8, 4.9, 2.9);
    let brick = s.about([0.68, 0.58, 0.50], 0.03);
    let floor = Material::new(Texture::Speckle([rgb(0.56, 0.55, 0.53), rgb(0.47, 0.46, 0.45)], 0.02));
    let walls = Material::new(Texture::Plaster(rgb(0.80, 0.78, 0.72)));
    let back = Material::new(Texture::Bricks([brick, rgb(0.72, 0.70, 0.66)]));
    let ceiling = Material::new(Texture::Planks([rgb(0.78, 0.66, 0.5), rgb(0.6, 0.47, 0.33)], 0.14));
    shell(s, [width, -0.4, depth, height], [floor, walls, back, ceiling]);
    let grain = s.between(0.0, 5.0);
    let beech = wood([0.80, 0.64, 0.46], [0.62, 0.45, 0.28], grain);
    let bench = Stand::at(-0.5 + s.between(-0.15, 0.15), depth - 0.4, 0.0);
    let top = Top { width: 2.2, depth: 0.7, height: 0.9, thickness: 0.06, leg: 0.04 };
    table(s, &bench, &top, beech, oak(grain + 1.0));
    s.block(&bench, [0.0, 0.0, 0.22], [2.0, 0.55, 0.03], beech);
    vice(s, &bench.then(-0.75, -0.3, 0.9));
    desk_lamp(s, &bench.then(0.85, 0.12, 0.9));
    tins(s, &bench.then(0.3, 0.15, 0.9), 4);
    tins(s, &bench.then(-0.4, 0.0, 0.235), 5);
    pegboard(s, &Stand::at(-0.5, depth, 1.62), beech);
    steel_rack(s, &Stand::at(1.55, depth - 0.32, 0.0));
    let foot = s.between(0.48, 0.72);
    ladder(s, &Stand::at(0.5 * width - 0.04, 2.9, 0.0).turned(-90.0), foot);
    let askew = s.between(-25.0, 25.0);
    let trestles = Stand::at(0.55 + s.between(-0.2, 0.2), 2.35, 0.0).turned(askew);
    sawhorses(s, &trestles, beech);
    let seat = s.about([0.45, 0.2, 0.15], 0.1);
    let stool = Stand::at(-0.85 + s.between(-0.15, 0.15), 3.3, 0.0);
    bar_stool(s, &stool, Material::new(Texture::Plain(seat)));
    let red = enamel(0.66, 0.16, 0.13);
    cabinet(s, &Stand::at(-0.5 * width, 3.1, 0.0).turned(90.0), [0.7, 0.45, 0.95], [1, 5], red);
    pipes(s, depth, width);
    window(s, &Stand::at(-0.5 * width, 1.9, 1.6).turned(90.0), [1.2, 1.1], [3, 2], 1.1);
    let shade = Material::plain(0.75, 0.77, 0.7).glow(0.8);
    pendant(s, &Stand::at(0.1, 2.9, 0.0), height, 2.0, shade);
    let eye = eye(s, [0.1, -0.1, 1.5], -1.0, 12.0);
    let lights = vec![
        light([0.1, 2.9, 1.92], 0.12, 1.5, WARM),
        light([0.4, 1.2, 2.75], 0.3, 1.6, [1.0, 0.95, 0.88]),
        light([-2.2, 1.9, 1.7], 0.3, 1.4, DAY),
    ];
    Setting { lights, ambient: Colour::new(0.34, 0.34, 0.33), eye, field_of_view: 66.0 }
}

/// A board with hammers, saws and screwdrivers on the wall y = 0, centred on the stand.
fn pegboard(s: &mut Stage, stand: &Stand, handle: Material) {
    let board = Material::new(Texture::Plaster(rgb(0.47, 0.56, 0.52)));
    s.block(stand, [0.0, -0.01, 0.0], [2.0, 0.02, 0.85], board);
    for k in 0..4 {
        let (x, long) = (-0.85 + 0.2 * f64::from(k), 0.24 + 0.03 * f64::from(k));
        s.rod(stand, [x, -0.05, 0.25 - long], [x, -0.05, 0.25], 0.012, handle);
        s.block(stand, [x, -0.05, 0.26], [0.11, 0.03, 0.035], metal(0.35));
    }
    for k in 0..7 {
        let x = 0.02 + 0.075 * f64::from(k);
        let tone = s.about([0.75, 0.4, 0.12], 0.2);
        let grip = Material::new(Texture::Plain(tone)).gloss(0.3);
        s.rod(stand, [x, -0.05, 0.18], [x, -0.05, 0.29], 0.013, grip);
        s.rod(stand, [x, -0.05, 0.02 - 0.012 * f64::from(k)], [x, -0.05, 0.18], 0.0035, metal(0.65));
    }
    for (x, z) in [(-0.6, -0.24), (0.2, -0.22)] {
        s.tilted(stand, [x, -0.03, z], [0.48, 0.003, 0.09], tip(6.0), metal(0.72));
        s.tilted(stand, [x - 0.29, -0.03, z - 0.03], [0.12, 0.022, 0.13], tip(6.0), handle);
    }
    for k in 0..5 {
        let (x, radius) = (0.66 + 0.07 * f64::from(k), 0.03 - 0.003 * f64::from(k));
        s.block(stand, [x, -0.03, -0.12], [0.014, 0.006, 0.2], metal(0.6));
        s.rod(stand, [x, -0.026, -0.01], [x, -0.034, -0.01], radius, metal(0.6));
    }
}

/// A turn within the plane of the wall y = 0.
fn tip(degrees: f64) -> nalgebra::Rotation3<f64> {
    nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), degrees.to_radians())
}

fn vice(s: &mut Stage, stand: &Stand) {
    let blue = enamel(0.15, 0.28, 0.5);
    s.block(stand, [0.0, 0.05, 0.05], [0.14, 0.16, 0.1], blue);
    s.block(stand, [0.0, -0.1, 0.09], [0.16, 0.05, 0.1], blue);
    s.rod(stand, [0.0, -0.2, 0.06], [0.0, 0.0, 0.06], 0.016, metal(0.5));
    s.rod(stand, [-0.11, -0.2, 0.05], [0.11, -0.2, 0.07], 0.007, metal(0.6));
}

/// Tins of paint in a row along x.
fn tins(s: &mut Stage, stand: &Stand, count: usize) {
    for k in 0..count {
        let (x, tall) = (0.17 * (k as f64 - 0.5 * count as f64), s.between(0.1, 0.2));
        let (radius, y) = (s.between(0.05, 0.075), s.between(-0.04, 0.04));
        let paint = Material::new(Texture::Plain(s.about([0.5, 0.45, 0.4], 0.35))).gloss(0.3);
        s.rod(stand, [x, y, 0.0], [x, y, 0.7 * tall], radius, paint);
        s.rod(stand, [x, y, 0.7 * tall], [x, y, tall], radius, metal(0.7));
    }
}

/// Shelves on thin steel posts, with boxes.
fn steel_rack(s: &mut Stage, stand: &Stand) {
    let (wide, deep, tall) = (1.2, 0.45, 2.0);
    for x in [-0.5 * wide, 0.5 * wide] {
        for y in [-0.5 * deep, 0.5 * deep] {
            s.block(stand, [x, y, 0.5 * tall], [0.028, 0.028, tall], metal(0.42));
        }
        let (low, high) = ([x, 0.5 * deep, 0.2], [x, -0.5 * deep, 1.0]);
        s.rod(stand, low, high, 0.006, metal(0.42));
    }
    for level in 0..4 {
        let z = 0.2 + 0.56 * f64::from(level);
        s.block(stand, [0.0, 0.0, z], [wide, deep, 0.02], metal(0.55));
        let mut x = -0.5 * wide + 0.05;
        while x < 0.5 * wide - 0.3 {
            let (w, h) = (s.between(0.2, 0.34), s.between(0.14, 0.36));
            let y = s.between(-0.04, 0.04);
            let card = s.about([0.66, 0.52, 0.36], 0.1);
            let card = Material::new(Texture::Plaster(card));
            let turn = s.between(-8.0, 8.0);
            s.tilted(stand, [x + 0.5 * w, y, z + 0.01 + 0.5 * h], [w, 0.34, h], lean(0.0, turn), card);
            let label = Material::plain(0.9, 0.9, 0.86);
            s.block(stand, [x + 0.5 * w, y - 0.185, z + 0.6 * h], [0.1, 0.003, 0.06], label);
            x += w + s.between(0.03, 0.12);
        }
    }
}

/// A ladder that leans on the wall y = 0, its foot that far from it.
fn ladder(s: &mut Stage, stand: &Stand, foot: f64) {
    let (tall, half) = (2.3, 0.21);
    let at = |share: f64| (-foot * (1.0 - share) - 0.03, tall * share);
    let aluminium = metal(0.75);
    for x in [-half, half] {
        let ((y0, z0), (y1, z1)) = (at(0.0), at(1.0));
        s.rod(stand, [x, y0, z0], [x, y1, z1], 0.018, aluminium);
    }
    for k in 1..9 {
        let (y, z) = at(f64::from(k) / 9.0);
        s.rod(stand, [-half, y, z], [half, y, z], 0.012, aluminium);
    }
}

/// Two trestles with planks across.
fn sawhorses(s: &mut Stage, stand: &Stand, timber: Material) {
    for x in [-0.55, 0.55] {
        s.block(stand, [x, 0.0, 0.62], [0.07, 0.75, 0.05], timber);
        for y in [-0.3, 0.3] {
            for side in [-1.0, 1.0] {
                s.rod(stand, [x, y, 0.62], [x + 0.17 * side, y * 1.15, 0.0], 0.016, timber);
            }
        }
    }
    for (k, y) in [-0.18, 0.02, 0.2].into_iter().enumerate() {
        let (long, turn) = (1.5 + 0.15 * k as f64, s.between(-4.0, 4.0));
        let plank = oak(2.0 + 3.0 * k as f64);
        s.tilted(stand, [0.05 * k as f64, y, 0.658], [long, 0.14, 0.026], lean(0.0, turn), plank);
    }
}

/// Pipes under the ceiling and down the corner.
fn pipes(s: &mut Stage, depth: f64, width: f64) {
    let origin = Stand::at(0.0, 0.0, 0.0);
    let (x, y) = (0.5 * width - 0.12, depth - 0.1);
    for (k, copper) in [(0, [0.72, 0.45, 0.3]), (1, [0.66, 0.66, 0.64])] {
        let [r, g, b]: [f64; 3] = copper;
        let (material, shift) = (Material::plain(r, g, b).gloss(0.5), 0.11 * f64::from(k));
        s.rod(&origin, [-0.5 * width, y, 2.62 - shift], [x, y, 2.62 - shift], 0.02, material);
        s.rod(&origin, [x - shift, y, 0.0], [x - shift, y, 2.62 - shift], 0.02, material);
        s.ball(&origin, [x - shift, y, 2.62 - shift], 0.028, material);
    }
}
