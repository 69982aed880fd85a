use super::*;

pub(super) fn furnish(s: &mut Stage) -> Setting {
    let (width, depth, height) = (4.6, 4.7, 2.6);
    let paper = s.about([0.72, 0.70, 0.76], 0.06);
    let walls = Material::new(Texture::Plaster(s.about([0.84, 0.81, 0.78], 0.04)));
    let floor =
        Material::new(Texture::Planks([rgb(0.62, 0.46, 0.32), rgb(0.40, 0.27, 0.17)], 0.11)).gloss(0.08);
    let back = Material::new(Texture::Stripes([paper, paper * 0.82], 0.14));
    let ceiling = Material::new(Texture::Plaster(rgb(0.96, 0.95, 0.94)));
    shell(s, [width, -0.4, depth, height], [floor, walls, back, ceiling]);
    let grain = s.between(0.0, 5.0);
    let x = s.between(-0.35, -0.05);
    let (first, second) = (s.about([0.30, 0.40, 0.52], 0.12), s.about([0.80, 0.76, 0.68], 0.05));
    let cover = Material::new(Texture::Tiles([first, second, second * 0.7], 0.12));
    bed(s, &Stand::at(x, depth - 1.1, 0.0), 1.5, metal(0.16), cover);
    let shade = Material::plain(0.98, 0.90, 0.74).glow(0.9);
    for side in [-1.0, 1.0] {
        let stand = Stand::at(x + side * 1.05, depth - 0.3, 0.0);
        let top = Top { width: 0.42, depth: 0.38, height: 0.52, thickness: 0.018, leg: 0.01 };
        table(s, &stand, &top, walnut(grain), walnut(grain + 1.0));
        let foot = Material::new(Texture::Speckle([rgb(0.75, 0.6, 0.5), rgb(0.4, 0.3, 0.3)], 0.015));
        table_lamp(s, &stand.then(0.0, 0.03, 0.52), 0.46, shade, foot.gloss(0.3));
    }
    picture(s, &Stand::at(x, depth, 1.75), [0.95, 0.6], walnut(grain));
    cabinet(s, &Stand::at(-0.5 * width, 2.35, 0.0).turned(90.0), [1.5, 0.55, 2.1], [3, 1], oak(grain));
    let rail = Stand::at(1.72, 2.3, 0.0).turned(s.between(-14.0, 14.0));
    clothes_rail(s, &rail);
    let turn = s.between(130.0, 165.0);
    chair(s, &Stand::at(-0.95, 1.95, 0.0).turned(turn), enamel(0.86, 0.84, 0.78), 5);
    let wall = Stand::at(0.5 * width, 3.4, 0.0).turned(-90.0);
    window(s, &wall.then(0.0, 0.0, 1.5), [1.2, 1.3], [2, 2], 1.0);
    let drape = s.about([0.56, 0.52, 0.62], 0.1);
    curtain(s, &wall, -1.02, -0.6, 2.3, drape);
    curtain(s, &wall, 0.6, 1.02, 2.3, drape);
    s.rod(&wall, [-1.15, -0.12, 2.32], [1.15, -0.12, 2.32], 0.012, metal(0.2));
    let colours =
        [s.about([0.80, 0.76, 0.70], 0.05), s.about([0.36, 0.30, 0.42], 0.08), rgb(0.60, 0.55, 0.50)];
    rug(s, &Stand::at(0.1, 1.75, 0.0), [2.1, 1.2], colours);
    plant(s, &Stand::at(1.85, depth - 0.42, 0.0), 0.8, 20);
    pendant(s, &Stand::at(0.25, 2.5, 0.0), height, 2.12, shade);
    let eye = eye(s, [0.2, -0.1, 1.42], 2.0, 12.0);
    let lights = vec![
        light([x - 1.05, depth - 0.3, 0.9], 0.08, 0.22, WARM),
        light([0.25, 2.5, 1.95], 0.15, 1.1, WARM),
        light([2.05, 3.4, 1.6], 0.3, 1.7, DAY),
        light([-0.2, 0.4, 2.4], 0.3, 0.8, WARM),
    ];
    Setting { lights, ambient: Colour::new(0.33, 0.33, 0.35), eye, field_of_view: 63.0 }
}

/// A rail on two thin uprights with clothes on hangers.
fn clothes_rail(s: &mut Stage, stand: &Stand) {
    let (steel, half, top) = (metal(0.25), 0.5, 1.55);
    for side in [-1.0, 1.0] {
        s.rod(stand, [side * half, 0.0, 0.05], [side * half, 0.0, top], 0.012, steel);
        s.rod(stand, [side * half, -0.25, 0.04], [side * half, 0.25, 0.04], 0.012, steel);
    }
    s.rod(stand, [-half, 0.0, top], [half, 0.0, top], 0.012, steel);
    s.rod(stand, [-half, 0.0, 0.2], [half, 0.0, 0.2], 0.008, steel);
    for k in 0..5 {
        let x = -0.4 + 0.13 * f64::from(k) + s.between(-0.02, 0.02);
        let tone = s.about([0.45, 0.42, 0.46], 0.25);
        let fabric = Material::new(Texture::Cloth(tone, 0.006));
        let long = s.between(0.55, 0.85);
        s.rod(stand, [x, 0.0, top], [x, 0.0, top - 0.08], 0.003, steel);
        let (centre, radii) = ([x, 0.0, top - 0.1 - 0.5 * long], [0.03, 0.22, 0.5 * long]);
        s.ellipsoid(stand, centre, radii, nalgebra::Rotation3::identity(), fabric);
    }
}
