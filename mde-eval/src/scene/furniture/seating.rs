use crate::scene::stage::{Stage, Stand, cloth, lean, metal};
use crate::scene::texture::{Colour, Material, Texture};
use nalgebra::Rotation3;

/// A wooden chair with tapered legs and a back of spindles.
pub(crate) fn chair(stage: &mut Stage, stand: &Stand, material: Material, spindles: usize) {
    let (half, seat, top) = (0.2, 0.45, 0.92);
    for x in [-half, half] {
        stage.cone(stand, [x * 1.08, -half * 1.05, 0.0], [x, -half * 0.95, seat], [0.012, 0.018], material);
        stage.cone(stand, [x * 1.08, half * 1.15, 0.0], [x, half * 0.95, seat], [0.012, 0.018], material);
        stage.rod(stand, [x, half * 0.95, seat], [x * 0.95, half * 1.3, top], 0.014, material);
        stage.rod(stand, [x * 1.05, -half, 0.2], [x * 1.05, half * 1.08, 0.2], 0.008, material);
    }
    stage.rod(stand, [-half, 0.0, 0.2], [half, 0.0, 0.2], 0.008, material);
    stage.block(stand, [0.0, 0.0, seat + 0.012], [0.45, 0.44, 0.026], material);
    stage.block(stand, [0.0, half * 1.3, top - 0.03], [0.42, 0.022, 0.08], material);
    for k in 0..spindles {
        let x = half * 0.8 * (2.0 * (k as f64 + 0.5) / spindles as f64 - 1.0);
        stage.rod(stand, [x, half, seat + 0.02], [x, half * 1.28, top - 0.06], 0.007, material);
    }
}

/// A stool on four thin splayed legs with a ring.
pub(crate) fn bar_stool(stage: &mut Stage, stand: &Stand, seat: Material) {
    let steel = metal(0.25);
    for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
        stage.rod(stand, [0.2 * x, 0.2 * y, 0.0], [0.11 * x, 0.11 * y, 0.68], 0.009, steel);
        let (near, next) = ([0.172 * x, 0.172 * y, 0.22], [-0.172 * y, 0.172 * x, 0.22]);
        stage.rod(stand, near, next, 0.007, steel);
    }
    stage.rod(stand, [0.0, 0.0, 0.68], [0.0, 0.0, 0.72], 0.18, seat);
}

/// A slatted bench.
pub(crate) fn bench(stage: &mut Stage, stand: &Stand, length: f64, material: Material) {
    for x in [-0.5 * length + 0.08, 0.5 * length - 0.08] {
        for y in [-0.15, 0.15] {
            stage.block(stand, [x, y, 0.21], [0.04, 0.04, 0.42], material);
        }
        stage.block(stand, [x, 0.0, 0.4], [0.03, 0.34, 0.03], material);
    }
    for k in 0..5 {
        stage.block(stand, [0.0, -0.148 + 0.074 * f64::from(k), 0.43], [length, 0.055, 0.022], material);
    }
}

/// A swivel chair: five-armed star base with castors, column, padded seat and back.
pub(crate) fn office_chair(stage: &mut Stage, stand: &Stand, colour: Colour) {
    let (steel, black, padding) = (metal(0.55), Material::plain(0.08, 0.08, 0.09), cloth(colour));
    for k in 0..5 {
        let (sin, cos) = (f64::from(k) * 1.256_64 + 0.3).sin_cos();
        stage.cone(stand, [0.0, 0.0, 0.11], [0.28 * cos, 0.28 * sin, 0.075], [0.022, 0.013], steel);
        stage.ball(stand, [0.28 * cos, 0.28 * sin, 0.035], 0.032, black);
    }
    stage.rod(stand, [0.0, 0.0, 0.08], [0.0, 0.0, 0.44], 0.022, steel);
    stage.ellipsoid(stand, [0.0, 0.0, 0.48], [0.25, 0.25, 0.06], Rotation3::identity(), padding);
    stage.rod(stand, [0.0, 0.2, 0.44], [0.0, 0.28, 0.72], 0.016, black);
    stage.tilted(stand, [0.0, 0.265, 0.82], [0.42, 0.05, 0.5], lean(8.0, 0.0), padding);
    for x in [-0.27, 0.27] {
        stage.rod(stand, [x, 0.1, 0.46], [x, 0.1, 0.66], 0.011, black);
        stage.block(stand, [x, 0.02, 0.67], [0.05, 0.26, 0.025], black);
    }
}

/// A sofa with seat and back cushions, thrown pillows and thin feet.
pub(crate) fn sofa(stage: &mut Stage, stand: &Stand, width: f64, seats: usize, colour: Colour) {
    let cover = cloth(colour);
    let feet = metal(0.2);
    for x in [-0.5 * width + 0.08, 0.5 * width - 0.08] {
        for y in [-0.36, 0.36] {
            stage.rod(stand, [x, y, 0.0], [x, y, 0.13], 0.014, feet);
        }
    }
    stage.block(stand, [0.0, 0.0, 0.21], [width, 0.86, 0.16], cover);
    stage.block(stand, [0.0, 0.36, 0.5], [width, 0.16, 0.62], cover);
    for side in [-1.0, 1.0] {
        let x = side * (0.5 * width - 0.08);
        stage.block(stand, [x, -0.01, 0.38], [0.16, 0.84, 0.36], cover);
        stage.rod(stand, [x, -0.43, 0.56], [x, 0.4, 0.56], 0.08, cover);
    }
    let room = width - 0.34;
    for k in 0..seats {
        let wide = room / seats as f64;
        let x = -0.5 * room + wide * (k as f64 + 0.5);
        stage.block(stand, [x, -0.08, 0.36], [wide - 0.015, 0.7, 0.14], cover);
        stage.tilted(stand, [x, 0.22, 0.6], [wide - 0.03, 0.14, 0.4], lean(-12.0, 0.0), cover);
    }
    for (side, colour) in [(-1.0, [0.82, 0.55, 0.22]), (1.0, [0.20, 0.38, 0.45])] {
        let (turn, tone) = (stage.between(-22.0, 22.0), stage.about(colour, 0.1));
        let pillow = Material::new(Texture::Stripes([tone, tone * 0.55], 0.05));
        let x = side * (0.5 * room - 0.26);
        stage.ellipsoid(stand, [x, 0.05, 0.6], [0.23, 0.09, 0.21], lean(-24.0, turn), pillow);
    }
}

/// A bed, its head towards +y, with a headboard of thin bars.
pub(crate) fn bed(stage: &mut Stage, stand: &Stand, width: f64, frame: Material, cover: Material) {
    let (length, linen) = (2.0, cloth(Colour::new(0.82, 0.80, 0.76)));
    stage.block(stand, [0.0, 0.0, 0.25], [width, length, 0.1], frame);
    stage.block(stand, [0.0, 0.0, 0.4], [width - 0.04, length - 0.04, 0.2], linen);
    stage.block(stand, [0.0, -0.28, 0.43], [width + 0.03, 1.46, 0.22], cover);
    stage.block(stand, [0.0, 0.42, 0.545], [width + 0.02, 0.22, 0.03], linen);
    for side in [-1.0, 1.0] {
        let x = 0.24 * side * width;
        let turn = stage.between(-6.0, 6.0);
        stage.ellipsoid(stand, [x, 0.75, 0.57], [0.2 * width, 0.2, 0.1], lean(14.0, turn), linen);
        let post = 0.5 * side * width;
        stage.rod(stand, [post, 0.5 * length, 0.0], [post, 0.5 * length, 1.15], 0.02, frame);
        stage.ball(stand, [post, 0.5 * length, 1.17], 0.035, frame);
        stage.rod(stand, [post, -0.5 * length, 0.0], [post, -0.5 * length, 0.55], 0.02, frame);
    }
    for z in [0.6, 1.08] {
        stage.rod(stand, [-0.5 * width, 0.5 * length, z], [0.5 * width, 0.5 * length, z], 0.013, frame);
    }
    let bars = (width / 0.11) as usize;
    for k in 0..bars {
        let x = width * ((k as f64 + 0.5) / bars as f64 - 0.5);
        stage.rod(stand, [x, 0.5 * length, 0.6], [x, 0.5 * length, 1.08], 0.007, frame);
    }
    stage.rod(stand, [-0.5 * width, -0.5 * length, 0.5], [0.5 * width, -0.5 * length, 0.5], 0.013, frame);
}
