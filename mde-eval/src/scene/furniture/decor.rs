use crate::scene::stage::{Stage, Stand, cloth, enamel, lean, metal};
use crate::scene::texture::{Colour, Material, Texture, rgb};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// A framed picture on the wall y = 0, centred on the stand.
pub(crate) fn picture(stage: &mut Stage, stand: &Stand, [width, height]: [f64; 2], frame: Material) {
    let seed = stage.between(0.0, 10.0);
    let mat = Material::plain(0.93, 0.92, 0.88);
    stage.block(stand, [0.0, -0.008, 0.0], [width, 0.012, height], mat);
    let image = Material::new(Texture::Painting(seed));
    stage.block(stand, [0.0, -0.014, 0.0], [0.76 * width, 0.004, 0.76 * height], image);
    for side in [-1.0, 1.0] {
        stage.block(stand, [side * 0.5 * width, -0.014, 0.0], [0.026, 0.028, height + 0.026], frame);
        stage.block(stand, [0.0, -0.014, side * 0.5 * height], [width + 0.026, 0.028, 0.026], frame);
    }
}

/// A window on the wall y = 0 centred on the stand, with glazing bars and a sill.
pub(crate) fn window(stage: &mut Stage, stand: &Stand, size: [f64; 2], bars: [usize; 2], brightness: f64) {
    let [width, height] = size;
    let seed = stage.between(0.0, 10.0);
    let white = enamel(0.93, 0.93, 0.91);
    let view = Material::new(Texture::Outdoors(seed)).glow(brightness);
    stage.block(stand, [0.0, -0.004, 0.0], [width, 0.008, height], view);
    for side in [-1.0, 1.0] {
        stage.block(stand, [side * 0.5 * width, -0.02, 0.0], [0.06, 0.06, height + 0.06], white);
        stage.block(stand, [0.0, -0.02, side * 0.5 * height], [width + 0.06, 0.06, 0.06], white);
    }
    for k in 1..bars[0] {
        let x = width * (k as f64 / bars[0] as f64 - 0.5);
        stage.block(stand, [x, -0.022, 0.0], [0.026, 0.036, height], white);
    }
    for k in 1..bars[1] {
        let z = height * (k as f64 / bars[1] as f64 - 0.5);
        stage.block(stand, [0.0, -0.022, z], [width, 0.036, 0.026], white);
    }
    stage.block(stand, [0.0, -0.09, -0.5 * height - 0.04], [width + 0.16, 0.2, 0.024], white);
}

/// A drawn curtain of upright folds from `left` to `right`, hanging from a rod at `top`, in front of the wall y = 0.
pub(crate) fn curtain(stage: &mut Stage, stand: &Stand, left: f64, right: f64, top: f64, colour: Colour) {
    let fabric = cloth(colour);
    let folds = ((right - left) / 0.075).ceil().max(1.0) as usize;
    for k in 0..folds {
        let x = left + (right - left) * (k as f64 + 0.5) / folds as f64;
        let y = -0.12 - if k % 2 == 0 { 0.015 } else { -0.015 };
        let wide = stage.between(0.036, 0.048);
        stage.cone(stand, [x, y, 0.04], [x, y, top - 0.02], [wide, 0.034], fabric);
    }
}

/// A pot plant: stems with leaves that turn outwards.
pub(crate) fn plant(stage: &mut Stage, stand: &Stand, height: f64, leaves: usize) {
    let pot = stage.about([0.72, 0.44, 0.32], 0.12);
    let clay = Material::new(Texture::Speckle([pot, pot * 0.6], 0.01));
    let tall = 0.24 * height;
    stage.cone(stand, [0.0, 0.0, 0.0], [0.0, 0.0, tall], [0.11 * height + 0.02, 0.15 * height + 0.03], clay);
    let (soil, radius) = (Material::plain(0.2, 0.14, 0.1), 0.13 * height + 0.02);
    stage.rod(stand, [0.0, 0.0, tall], [0.0, 0.0, tall + 0.004], radius, soil);
    for k in 0..leaves {
        let (turn, rise) = (2.4 * k as f64 + stage.between(-0.4, 0.4), stage.between(0.45, 1.0));
        let reach = height * stage.between(0.12, 0.34) * (1.2 - 0.5 * rise);
        let (sin, cos) = turn.sin_cos();
        let green = stage.about([0.24, 0.46, 0.2], 0.09);
        let tip = [reach * cos, reach * sin, height * rise];
        let stem = Material::new(Texture::Plain(green * 0.6));
        stage.rod(stand, [0.02 * cos, 0.02 * sin, tall], tip, 0.0045, stem);
        let long = height * stage.between(0.10, 0.17);
        let droop = stage.between(10.0, 60.0_f64).to_radians();
        let along = Rotation3::from_axis_angle(&Vector3::z_axis(), turn)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), droop);
        let leaf = Material::new(Texture::Stripes([green, green * 0.75], 0.012)).gloss(0.1);
        stage.ellipsoid(stand, tip, [long, 0.42 * long, 0.004], along, leaf);
    }
}

pub(crate) fn rug(stage: &mut Stage, stand: &Stand, size: [f64; 2], colours: [Colour; 3]) {
    let pile = Material::new(Texture::Rug(colours));
    stage.block(stand, [0.0, 0.0, 0.005], [size[0], size[1], 0.01], pile);
}

/// A radiator of upright columns in front of the wall y = 0.
pub(crate) fn radiator(stage: &mut Stage, stand: &Stand, width: f64) {
    let white = enamel(0.9, 0.9, 0.87);
    let columns = (width / 0.05) as usize;
    for k in 0..columns {
        let x = width * ((k as f64 + 0.5) / columns as f64 - 0.5);
        for y in [-0.13, -0.06] {
            stage.rod(stand, [x, y, 0.14], [x, y, 0.7], 0.013, white);
        }
    }
    for z in [0.15, 0.69] {
        stage.rod(stand, [-0.5 * width, -0.095, z], [0.5 * width, -0.095, z], 0.022, white);
    }
    stage.rod(stand, [0.5 * width, -0.095, 0.0], [0.5 * width, -0.095, 0.15], 0.01, metal(0.7));
}

/// A stand with pegs, a coat and a hat.
pub(crate) fn coat_stand(stage: &mut Stage, stand: &Stand, material: Material) {
    stage.rod(stand, [0.0, 0.0, 0.02], [0.0, 0.0, 1.75], 0.017, material);
    for k in 0..4 {
        let (sin, cos) = (FRAC_PI_2 * f64::from(k) + 0.5).sin_cos();
        stage.cone(stand, [0.0, 0.0, 0.18], [0.24 * cos, 0.24 * sin, 0.0], [0.014, 0.011], material);
        stage.cone(stand, [0.0, 0.0, 1.55], [0.15 * cos, 0.15 * sin, 1.68], [0.012, 0.008], material);
        stage.ball(stand, [0.15 * cos, 0.15 * sin, 1.68], 0.016, material);
    }
    let wool = stage.about([0.32, 0.30, 0.42], 0.15);
    stage.cone(stand, [0.1, -0.1, 0.75], [0.12, -0.08, 1.62], [0.17, 0.06], cloth(wool));
    let felt = cloth(rgb(0.35, 0.25, 0.16));
    stage.ellipsoid(stand, [0.0, 0.0, 1.76], [0.15, 0.15, 0.015], lean(10.0, 0.0), felt);
    stage.ellipsoid(stand, [0.0, 0.0, 1.79], [0.085, 0.085, 0.07], lean(10.0, 0.0), felt);
}

/// Plate, cup, bottle and fruit around the stand, on z = 0.
pub(crate) fn crockery(stage: &mut Stage, stand: &Stand, spread: f64) {
    let white = enamel(0.92, 0.91, 0.88);
    stage.cone(stand, [-0.3 * spread, -0.1, 0.0], [-0.3 * spread, -0.1, 0.02], [0.07, 0.12], white);
    for (k, red) in [0.75, 0.85, 0.55].into_iter().enumerate() {
        let (sin, cos) = (2.1 * k as f64).sin_cos();
        let skin = Material::plain(red, 0.55 * red, 0.12).gloss(0.2);
        stage.ball(stand, [-0.3 * spread + 0.045 * cos, -0.1 + 0.045 * sin, 0.055], 0.038, skin);
    }
    let tone = stage.about([0.25, 0.45, 0.55], 0.2);
    let cup = Material::new(Texture::Plain(tone)).gloss(0.3);
    stage.cone(stand, [0.35 * spread, -0.12, 0.0], [0.35 * spread, -0.12, 0.09], [0.032, 0.04], cup);
    let glass = Material::plain(0.16, 0.3, 0.18).gloss(0.6);
    stage.rod(stand, [0.1 * spread, 0.06, 0.0], [0.1 * spread, 0.06, 0.2], 0.036, glass);
    stage.cone(stand, [0.1 * spread, 0.06, 0.2], [0.1 * spread, 0.06, 0.24], [0.036, 0.013], glass);
    stage.rod(stand, [0.1 * spread, 0.06, 0.24], [0.1 * spread, 0.06, 0.3], 0.013, glass);
}
