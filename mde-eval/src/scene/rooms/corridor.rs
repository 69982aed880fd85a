use super::*;

pub(super) fn furnish(s: &mut Stage) -> Setting {
    let (width, depth, height) = (2.3, 7.4, 2.6);
    let walls = Material::new(Texture::Plaster(s.about([0.80, 0.76, 0.66], 0.06)));
    let tiles = [rgb(0.76, 0.72, 0.64), rgb(0.33, 0.31, 0.30), rgb(0.4, 0.38, 0.35)];
    let brick = s.about([0.60, 0.32, 0.24], 0.06);
    let floor = Material::new(Texture::Tiles(tiles, 0.25)).gloss(0.2);
    let back = Material::new(Texture::Bricks([brick, rgb(0.72, 0.69, 0.64)]));
    let ceiling = Material::new(Texture::Plaster(rgb(0.94, 0.94, 0.92)));
    shell(s, [width, -0.5, depth, height], [floor, walls, back, ceiling]);
    let grain = s.between(0.0, 5.0);
    let half = 0.5 * width;
    let paint = Material::new(Texture::Plain(s.about([0.42, 0.50, 0.52], 0.12))).gloss(0.15);
    let white = enamel(0.90, 0.90, 0.87);
    for y in [1.75, 5.1] {
        door(s, &Stand::at(-half, y, 0.0).turned(90.0), paint, white);
    }
    door(s, &Stand::at(half, 3.2, 0.0).turned(-90.0), paint, white);
    door(s, &Stand::at(half, 6.4, 0.0).turned(-90.0), walnut(grain), white);
    window(s, &Stand::at(0.0, depth, 1.55), [0.9, 1.2], [2, 3], 0.9);
    let colours = [s.about([0.45, 0.18, 0.18], 0.07), rgb(0.82, 0.70, 0.48), s.about([0.16, 0.2, 0.3], 0.05)];
    rug(s, &Stand::at(0.0, 4.2, 0.0), [0.95, 4.6], colours);
    radiator(s, &Stand::at(half, 4.75, 0.0).turned(-90.0), 1.1);
    let x = s.between(0.62, 0.74);
    coat_stand(s, &Stand::at(x, 2.25, 0.0), walnut(grain + 1.0));
    bench(s, &Stand::at(-half + 0.22, 3.4, 0.0).turned(90.0), 1.15, oak(grain));
    for (k, z) in [(3.05, 1.6), (3.75, 1.55)] {
        let size = [s.between(0.34, 0.5), s.between(0.42, 0.6)];
        picture(s, &Stand::at(-half, k, z).turned(90.0), size, walnut(grain + k));
    }
    picture(s, &Stand::at(half, 4.75, 1.6).turned(-90.0), [0.7, 0.5], enamel(0.12, 0.12, 0.12));
    // A console on thin legs at the far end, with a lamp.
    let console = Stand::at(-half + 0.24, 6.35, 0.0).turned(90.0);
    let top = Top { width: 0.9, depth: 0.32, height: 0.8, thickness: 0.018, leg: 0.009 };
    table(s, &console, &top, oak(grain), metal(0.15));
    let shade = Material::plain(0.98, 0.88, 0.68).glow(1.0);
    table_lamp(s, &console.then(-0.1, 0.0, 0.8), 0.45, shade, enamel(0.2, 0.3, 0.4));
    umbrellas(s, &Stand::at(-half + 0.17, 2.5, 0.0));
    plant(s, &Stand::at(0.8, depth - 0.4, 0.0), 0.9, 18);
    let bowl = Material::plain(0.97, 0.93, 0.84).glow(0.9);
    for y in [2.7, 5.2] {
        let h = 2.2 + s.between(-0.05, 0.05);
        pendant(s, &Stand::at(0.0, y, 0.0), height, h, bowl);
    }
    let eye = eye(s, [0.05, 0.0, 1.45], 0.5, 8.0);
    let lights = vec![
        light([0.0, 2.7, 2.1], 0.15, 1.0, WARM),
        light([0.0, 5.2, 2.1], 0.15, 1.0, WARM),
        light([0.0, 0.2, 2.4], 0.2, 0.7, WARM),
    ];
    Setting { lights, ambient: Colour::new(0.24, 0.25, 0.27), eye, field_of_view: 62.0 }
}

fn umbrellas(s: &mut Stage, stand: &Stand) {
    s.cone(stand, [0.0, 0.0, 0.0], [0.0, 0.0, 0.48], [0.1, 0.12], metal(0.35));
    for k in 0..3 {
        let (dx, dy) = (s.between(-0.08, 0.08), s.between(-0.08, 0.08));
        let tone = Material::new(Texture::Plain(s.about([0.3, 0.25, 0.4], 0.2)));
        let top = 0.78 + 0.04 * f64::from(k);
        s.cone(stand, [0.3 * dx, 0.3 * dy, 0.03], [0.8 * dx, 0.8 * dy, 0.65], [0.012, 0.03], tone);
        s.rod(stand, [0.8 * dx, 0.8 * dy, 0.65], [dx, dy, top], 0.006, walnut(f64::from(k)));
        s.ball(stand, [dx, dy, top], 0.014, walnut(f64::from(k)));
    }
}
