use super::*;

pub(super) fn furnish(s: &mut Stage) -> Setting {
    let (width, depth) = (4.2, 4.4);
    let wall = s.about([0.74, 0.76, 0.70], 0.06);
    let plaster = Material::new(Texture::Plaster(wall));
    let floor =
        Material::new(Texture::Planks([rgb(0.72, 0.54, 0.36), rgb(0.48, 0.32, 0.19)], 0.13)).gloss(0.1);
    let back = Material::new(Texture::Stripes([wall, wall * 0.86], 0.09));
    let ceiling = Material::new(Texture::Plaster(rgb(0.95, 0.95, 0.93)));
    shell(s, [width, -0.4, depth, 2.6], [floor, plaster, back, ceiling]);
    let grain = s.between(0.0, 5.0);
    let shift = s.between(-0.15, 0.15);
    // The desk by the back wall, with its chair pulled out.
    let desk = Stand::at(0.25 + shift, depth - 0.42, 0.0);
    let top = Top { width: 1.5, depth: 0.7, height: 0.74, thickness: 0.03, leg: 0.018 };
    table(s, &desk, &top, oak(grain), oak(grain + 0.3));
    computer(s, &desk.then(0.1, 0.05, 0.74), grain);
    desk_lamp(s, &desk.then(-0.58, 0.12, 0.74));
    let books = desk.then(0.5, 0.02, 0.74);
    book_row(s, &books, 0.22, 0.22);
    let turn = s.between(-35.0, 35.0);
    chair(s, &Stand::at(0.2 + shift, depth - 1.25, 0.0).turned(180.0 + turn), walnut(grain), 4);
    // A second chair stands free nearer by: its legs are thin at any size.
    let (x, turn) = (s.between(0.95, 1.2), s.between(20.0, 60.0));
    chair(s, &Stand::at(x, 2.0, 0.0).turned(turn), oak(grain + 2.0), 5);
    let shade = Material::plain(0.98, 0.90, 0.72).glow(0.9);
    let lamp = Stand::at(-0.92 + s.between(-0.08, 0.08), depth - 0.75, 0.0);
    floor_lamp(s, &lamp, 1.62, shade);
    let shelves = Stand::at(-0.5 * width + 0.17, 2.7, 0.0).turned(90.0);
    bookcase(s, &shelves, [1.25, 2.05], 5, oak(grain + 1.0), true);
    for (x, z, wide) in [(0.25, 1.42, 1.2), (0.45, 1.86, 0.9)] {
        wall_shelf(s, &Stand::at(x + shift, depth, z), wide, walnut(grain + x));
    }
    picture(s, &Stand::at(-1.45, depth, 1.62), [0.5, 0.66], walnut(grain));
    window(s, &Stand::at(0.5 * width, 2.9, 1.5).turned(-90.0), [1.3, 1.2], [2, 2], 0.9);
    let tall = s.between(0.8, 1.05);
    plant(s, &Stand::at(1.72, depth - 0.42, 0.0), tall, 22);
    let colours = [s.about([0.55, 0.22, 0.2], 0.08), rgb(0.84, 0.74, 0.55), s.about([0.2, 0.25, 0.36], 0.05)];
    rug(s, &Stand::at(-0.1, 2.35, 0.0), [1.9, 1.3], colours);
    let eye = eye(s, [-0.15, 0.05, 1.38], -2.0, 14.0);
    let lights = vec![
        light([-0.92, depth - 0.75, 1.5], 0.1, 0.55, WARM),
        light([0.1, 1.6, 2.5], 0.25, 1.5, WARM),
        light([1.9, 2.9, 1.6], 0.3, 1.5, DAY),
    ];
    Setting { lights, ambient: Colour::new(0.33, 0.34, 0.36), eye, field_of_view: 62.0 }
}
