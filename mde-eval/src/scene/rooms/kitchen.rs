use super::*;

pub(super) fn furnish(s: &mut Stage) -> Setting {
    let (width, depth, height) = (4.4, 4.6, 2.55);
    let tile = s.about([0.80, 0.80, 0.76], 0.05);
    let walls = Material::new(Texture::Plaster(s.about([0.86, 0.82, 0.70], 0.05)));
    let second = s.about([0.78, 0.84, 0.84], 0.04);
    let floor =
        Material::new(Texture::Tiles([tile, rgb(0.42, 0.44, 0.45), rgb(0.3, 0.3, 0.29)], 0.33)).gloss(0.15);
    let back =
        Material::new(Texture::Tiles([rgb(0.88, 0.89, 0.87), second, rgb(0.6, 0.6, 0.58)], 0.15)).gloss(0.2);
    let ceiling = Material::new(Texture::Plaster(rgb(0.95, 0.95, 0.94)));
    shell(s, [width, -0.4, depth, height], [floor, walls, back, ceiling]);
    let grain = s.between(0.0, 5.0);
    let front = Material::new(Texture::Plain(s.about([0.34, 0.46, 0.46], 0.14))).gloss(0.15);
    counter(s, depth, front, grain);
    fridge(s, &Stand::at(1.82, depth - 0.36, 0.0));
    // The table with chairs and two stools around it.
    let middle = Stand::at(s.between(-0.5, -0.25), 2.65, 0.0).turned(s.between(-10.0, 10.0));
    let top = Top { width: 1.25, depth: 0.8, height: 0.75, thickness: 0.03, leg: 0.017 };
    table(s, &middle, &top, oak(grain), enamel(0.9, 0.9, 0.86));
    crockery(s, &middle.then(0.0, 0.0, 0.75), 1.1);
    let turns = [s.between(-12.0, 12.0), s.between(-12.0, 12.0), s.between(-20.0, 20.0)];
    chair(s, &middle.then(-0.28, -0.62, 0.0).turned(180.0 + turns[0]), walnut(grain), 4);
    chair(s, &middle.then(0.82, 0.05, 0.0).turned(-90.0 + turns[1]), walnut(grain + 1.0), 4);
    chair(s, &middle.then(-0.05, 0.64, 0.0).turned(turns[2]), walnut(grain + 2.0), 4);
    let (x, y) = (1.15 + s.between(-0.1, 0.1), 2.62 + s.between(-0.1, 0.1));
    bar_stool(s, &Stand::at(x, 1.95, 0.0), oak(grain));
    bar_stool(s, &Stand::at(1.62, y, 0.0), oak(grain + 1.0));
    let shade = Material::new(Texture::Plain(s.about([0.75, 0.3, 0.2], 0.12))).glow(0.5);
    for (k, lift) in [(-0.32, 1.62), (0.34, 1.56)] {
        let h = lift + s.between(-0.04, 0.04);
        pendant(s, &middle.then(k, 0.0, 0.0), height, h, shade);
    }
    let side = Stand::at(-0.5 * width, 2.6, 0.0).turned(90.0);
    window(s, &side.then(0.2, 0.0, 1.5), [1.2, 1.1], [2, 1], 1.0);
    plant(s, &side.then(0.2, -0.1, 0.94), 0.34, 14);
    wall_shelf(s, &Stand::at(0.5 * width, 2.7, 1.55).turned(-90.0), 1.0, oak(grain));
    let eye = eye(s, [0.05, -0.05, 1.45], 1.0, 14.0);
    let lights = vec![
        light([-0.4, 2.65, 1.42], 0.1, 0.5, WARM),
        light([0.3, 1.8, 2.45], 0.3, 1.7, WARM),
        light([-1.95, 2.7, 1.6], 0.3, 1.8, DAY),
    ];
    Setting { lights, ambient: Colour::new(0.36, 0.37, 0.38), eye, field_of_view: 64.0 }
}

/// Floor and wall cupboards along the back wall, worktop, tap, hood, a rail with utensils.
fn counter(s: &mut Stage, depth: f64, front: Material, grain: f64) {
    let wall = Stand::at(0.0, depth, 0.0);
    cabinet(s, &wall.then(-0.4, 0.0, 0.1), [3.6, 0.58, 0.78], [6, 1], front);
    let stone = Material::new(Texture::Speckle([rgb(0.25, 0.25, 0.26), rgb(0.7, 0.7, 0.68)], 0.008));
    s.block(&wall, [-0.4, -0.31, 0.9], [3.64, 0.64, 0.04], stone.gloss(0.3));
    cabinet(s, &wall.then(-1.45, 0.0, 1.5), [1.4, 0.33, 0.7], [3, 1], front);
    cabinet(s, &wall.then(0.95, 0.0, 1.5), [0.9, 0.33, 0.7], [2, 1], front);
    let steel = metal(0.6);
    // Hood over the hob.
    s.cone(&wall, [-0.12, -0.25, 1.62], [-0.12, -0.25, 1.85], [0.36, 0.12], steel);
    s.block(&wall, [-0.12, -0.16, 2.2], [0.24, 0.24, 0.7], steel);
    s.block(&wall, [-0.12, -0.32, 0.925], [0.58, 0.5, 0.012], Material::plain(0.05, 0.05, 0.05).gloss(0.5));
    let pot = enamel(0.62, 0.15, 0.12);
    s.rod(&wall, [-0.24, -0.28, 0.93], [-0.24, -0.28, 1.06], 0.1, pot);
    s.rod(&wall, [-0.24, -0.28, 1.06], [-0.24, -0.28, 1.075], 0.105, pot);
    s.rod(&wall, [-0.14, -0.3, 1.0], [0.02, -0.42, 1.01], 0.009, Material::plain(0.1, 0.1, 0.1));
    // Tap.
    s.rod(&wall, [0.9, -0.14, 0.92], [0.9, -0.14, 1.2], 0.012, steel);
    s.rod(&wall, [0.9, -0.14, 1.2], [0.9, -0.34, 1.18], 0.01, steel);
    s.rod(&wall, [0.9, -0.34, 1.18], [0.9, -0.34, 1.12], 0.011, steel);
    // A rail with utensils hanging from it.
    s.rod(&wall, [-2.05, -0.03, 1.4], [-0.85, -0.03, 1.4], 0.006, steel);
    for k in 0..5 {
        let x = -1.95 + 0.22 * f64::from(k) + s.between(-0.03, 0.03);
        let long = s.between(0.2, 0.3);
        s.rod(&wall, [x, -0.035, 1.4], [x, -0.035, 1.4 - long], 0.006, oak(grain + x));
        let upright = nalgebra::Rotation3::identity();
        s.ellipsoid(&wall, [x, -0.035, 1.37 - long], [0.028, 0.006, 0.045], upright, steel);
    }
    for (k, tone) in [[0.75, 0.72, 0.6], [0.6, 0.3, 0.2], [0.3, 0.4, 0.3]].into_iter().enumerate() {
        let x = 0.3 + 0.13 * k as f64;
        let high = s.between(0.12, 0.24);
        let jar = Material::new(Texture::Plain(s.about(tone, 0.08))).gloss(0.3);
        s.rod(&wall, [x, -0.12, 0.92], [x, -0.12, 0.92 + high], 0.05, jar);
        s.rod(&wall, [x, -0.12, 0.92 + high], [x, -0.12, 0.94 + high], 0.045, walnut(grain));
    }
}

fn fridge(s: &mut Stage, stand: &Stand) {
    let white = enamel(0.86, 0.87, 0.88);
    s.block(stand, [0.0, 0.0, 0.93], [0.66, 0.68, 1.86], white);
    for (z, tall) in [(0.55, 1.02), (1.46, 0.76)] {
        s.block(stand, [0.0, -0.35, z], [0.65, 0.03, tall], white);
        s.rod(stand, [-0.26, -0.4, z - 0.25], [-0.26, -0.4, z + 0.25], 0.01, metal(0.5));
    }
    for (x, z) in [(0.1, 1.5), (0.18, 1.36), (-0.02, 1.62)] {
        let note = Material::new(Texture::Painting(10.0 * (x + z)));
        s.block(stand, [x, -0.367, z], [0.09, 0.003, 0.12], note);
    }
}
