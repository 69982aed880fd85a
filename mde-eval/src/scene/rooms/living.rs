use super::*;

pub(super) fn furnish(s: &mut Stage) -> Setting {
    let (width, depth) = (5.4, 5.0);
    let walls = Material::new(Texture::Plaster(s.about([0.82, 0.78, 0.70], 0.05)));
    let back = Material::new(Texture::Plaster(s.about([0.50, 0.56, 0.55], 0.07)));
    let floor =
        Material::new(Texture::Planks([rgb(0.80, 0.68, 0.52), rgb(0.60, 0.46, 0.32)], 0.16)).gloss(0.1);
    let ceiling = Material::new(Texture::Plaster(rgb(0.96, 0.95, 0.93)));
    shell(s, [width, -0.4, depth, 2.7], [floor, walls, back, ceiling]);
    let grain = s.between(0.0, 5.0);
    let colour = s.about([0.36, 0.40, 0.44], 0.12);
    let x = s.between(-0.45, -0.2);
    sofa(s, &Stand::at(x, depth - 0.62, 0.0), 2.2, 3, colour);
    picture(s, &Stand::at(x - 0.45, depth, 1.62), [0.62, 0.8], walnut(grain));
    picture(s, &Stand::at(x + 0.42, depth, 1.68), [0.8, 0.56], enamel(0.1, 0.1, 0.1));
    let colours =
        [s.about([0.78, 0.72, 0.62], 0.06), s.about([0.24, 0.34, 0.42], 0.08), rgb(0.52, 0.24, 0.18)];
    rug(s, &Stand::at(0.0, 2.9, 0.0), [2.5, 1.7], colours);
    // Coffee table on four thin steel legs.
    let low = Top { width: 1.1, depth: 0.58, height: 0.42, thickness: 0.02, leg: 0.009 };
    let coffee = Stand::at(s.between(-0.25, 0.15), 3.0, 0.01).turned(s.between(-8.0, 8.0));
    table(s, &coffee, &low, walnut(grain + 1.0), metal(0.18));
    crockery(s, &coffee.then(0.0, 0.05, 0.42), 1.0);
    let shade = Material::plain(0.97, 0.88, 0.70).glow(1.0);
    let pole = s.between(1.12, 1.3);
    floor_lamp(s, &Stand::at(pole, depth - 0.6, 0.0), 1.7, shade);
    let turn = s.between(35.0, 60.0);
    chair(s, &Stand::at(1.32, 2.35, 0.0).turned(-turn), oak(grain), 6);
    let shelves = Stand::at(0.5 * width - 0.16, 3.6, 0.0).turned(-90.0);
    bookcase(s, &shelves, [1.4, 1.7], 4, oak(grain + 2.0), false);
    // A side table with a lamp at the left end of the sofa.
    let side = Stand::at(x - 1.42, depth - 0.5, 0.0);
    let top = Top { width: 0.45, depth: 0.45, height: 0.55, thickness: 0.018, leg: 0.01 };
    table(s, &side, &top, oak(grain), metal(0.2));
    let glaze = Material::new(Texture::Speckle([rgb(0.3, 0.45, 0.5), rgb(0.8, 0.8, 0.7)], 0.02));
    table_lamp(s, &side.then(0.0, 0.0, 0.55), 0.5, shade, glaze.gloss(0.4));
    let wall = Stand::at(-0.5 * width, 3.1, 0.0).turned(90.0);
    window(s, &wall.then(0.0, 0.0, 1.45), [1.6, 1.5], [3, 2], 1.0);
    let drape = s.about([0.62, 0.34, 0.26], 0.1);
    curtain(s, &wall, -1.35, -0.8, 2.32, drape);
    curtain(s, &wall, 0.8, 1.35, 2.32, drape);
    s.rod(&wall, [-1.5, -0.12, 2.34], [1.5, -0.12, 2.34], 0.014, metal(0.25));
    let tall = s.between(1.15, 1.4);
    plant(s, &Stand::at(2.15, depth - 0.5, 0.0), tall, 30);
    let eye = eye(s, [0.25, -0.1, 1.32], 3.0, 10.0);
    let lights = vec![
        light([pole, depth - 0.6, 1.58], 0.12, 0.7, WARM),
        light([-2.4, 3.1, 1.7], 0.3, 2.6, DAY),
        light([0.6, 1.4, 2.6], 0.3, 1.6, WARM),
    ];
    Setting { lights, ambient: Colour::new(0.34, 0.35, 0.37), eye, field_of_view: 64.0 }
}
