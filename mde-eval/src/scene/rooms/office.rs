use super::*;

pub(super) fn furnish(s: &mut Stage) -> Setting {
    let (width, depth, height) = (5.0, 4.8, 2.7);
    let walls = Material::new(Texture::Plaster(s.about([0.82, 0.83, 0.84], 0.04)));
    let ground = s.about([0.36, 0.40, 0.46], 0.08);
    let floor = Material::new(Texture::Speckle([ground, rgb(0.62, 0.63, 0.66)], 0.012));
    let back = Material::new(Texture::Plaster(s.about([0.72, 0.76, 0.80], 0.05)));
    let panels = [rgb(0.92, 0.92, 0.91), rgb(0.90, 0.90, 0.90), rgb(0.7, 0.7, 0.7)];
    let ceiling = Material::new(Texture::Tiles(panels, 0.6));
    shell(s, [width, -0.4, depth, height], [floor, walls, back, ceiling]);
    let grain = s.between(0.0, 5.0);
    let (steel, board) = (metal(0.35), oak(grain));
    let top = Top { width: 1.5, depth: 0.75, height: 0.73, thickness: 0.025, leg: 0.02 };
    let back = Stand::at(0.6 + s.between(-0.15, 0.15), depth - 0.45, 0.0);
    table(s, &back, &top, board, steel);
    computer(s, &back.then(0.0, 0.05, 0.73), 1.0 + grain);
    desk_lamp(s, &back.then(0.56, 0.12, 0.73));
    let turn = s.between(-30.0, 30.0);
    let seat = s.about([0.2, 0.3, 0.42], 0.1);
    office_chair(s, &back.then(-0.1, -0.85, 0.0).turned(180.0 + turn), seat);
    let side = Stand::at(-1.75, 2.7 + s.between(-0.15, 0.15), 0.0).turned(90.0);
    table(s, &side, &top, board, steel);
    computer(s, &side.then(0.15, 0.05, 0.73), 3.0 + grain);
    crockery(s, &side.then(-0.5, 0.0, 0.73), 0.6);
    let turn = s.between(-40.0, 40.0);
    office_chair(s, &side.then(0.0, -0.9, 0.0).turned(180.0 + turn), seat);
    let grey = enamel(0.62, 0.64, 0.65);
    cabinet(s, &Stand::at(-0.95, depth, 0.0), [0.48, 0.55, 1.05], [1, 3], grey);
    cabinet(s, &Stand::at(-1.47, depth, 0.0), [0.48, 0.55, 1.05], [1, 3], grey);
    plant(s, &Stand::at(-1.2, depth - 0.28, 1.05), 0.45, 16);
    whiteboard(s, &Stand::at(-1.2, depth, 1.78));
    wall_shelf(s, &Stand::at(0.75, depth, 1.62), 1.2, board);
    bookcase(s, &Stand::at(0.5 * width - 0.16, 2.3, 0.0).turned(-90.0), [1.0, 1.9], 5, grey, true);
    let wall = Stand::at(0.5 * width, 3.75, 1.55).turned(-90.0);
    window(s, &wall, [1.5, 1.4], [2, 1], 1.1);
    blinds(s, &wall, 1.46, 0.72);
    bin(s, &Stand::at(1.62, depth - 0.7, 0.0));
    let eye = eye(s, [0.0, -0.1, 1.42], 0.0, 11.0);
    let lights = vec![
        light([-0.8, 2.4, 2.62], 0.3, 1.7, [0.95, 0.98, 1.0]),
        light([1.0, 3.2, 2.62], 0.3, 1.4, [0.95, 0.98, 1.0]),
        light([2.2, 3.75, 1.6], 0.3, 1.4, DAY),
    ];
    Setting { lights, ambient: Colour::new(0.36, 0.38, 0.40), eye, field_of_view: 65.0 }
}

fn whiteboard(s: &mut Stage, stand: &Stand) {
    s.block(stand, [0.0, -0.012, 0.0], [1.5, 0.02, 0.95], enamel(0.95, 0.95, 0.95));
    for side in [-1.0, 1.0] {
        s.block(stand, [0.75 * side, -0.016, 0.0], [0.02, 0.03, 0.97], metal(0.6));
        s.block(stand, [0.0, -0.016, 0.475 * side], [1.52, 0.03, 0.02], metal(0.6));
    }
    s.block(stand, [0.0, -0.05, -0.49], [0.7, 0.08, 0.012], metal(0.6));
    for row in 0..5 {
        let long = s.between(0.25, 1.1);
        let ink = Material::new(Texture::Plain(s.about([0.15, 0.2, 0.5], 0.14)));
        let z = 0.34 - 0.15 * f64::from(row);
        s.tilted(stand, [-0.65 + 0.5 * long, -0.0225, z], [long, 0.001, 0.022], lean(0.0, 0.0), ink);
    }
}

/// Slats over the upper part of a window, `drop` as a share of its height.
fn blinds(s: &mut Stage, stand: &Stand, width: f64, drop: f64) {
    let (slat, top) = (enamel(0.88, 0.87, 0.82), 0.7);
    s.block(stand, [0.0, -0.09, top], [width, 0.05, 0.04], slat);
    let count = (1.4 * drop / 0.055) as usize;
    for k in 0..count {
        let z = top - 0.05 - 0.055 * k as f64;
        s.tilted(stand, [0.0, -0.09, z], [width, 0.045, 0.002], lean(28.0, 0.0), slat);
    }
    for x in [-0.45 * width, 0.45 * width] {
        s.rod(stand, [x, -0.115, top], [x, -0.115, top - 1.4 * drop], 0.0015, slat);
    }
}

fn bin(s: &mut Stage, stand: &Stand) {
    let wire = metal(0.2);
    for k in 0..16 {
        let (sin, cos) = (std::f64::consts::FRAC_PI_8 * f64::from(k)).sin_cos();
        s.rod(stand, [0.11 * cos, 0.11 * sin, 0.0], [0.14 * cos, 0.14 * sin, 0.32], 0.003, wire);
    }
    s.rod(stand, [0.0, 0.0, 0.0], [0.0, 0.0, 0.01], 0.115, wire);
    s.ball(stand, [0.02, 0.0, 0.1], 0.07, Material::plain(0.9, 0.9, 0.88));
    s.ball(stand, [-0.03, 0.03, 0.19], 0.06, Material::plain(0.85, 0.82, 0.6));
}
