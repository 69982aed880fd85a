use crate::scene::stage::{Stage, Stand, lean, metal};
use crate::scene::texture::{Material, Texture, rgb};

/// A table's measures.
pub(crate) struct Top {
    pub(crate) width: f64,
    pub(crate) depth: f64,
    pub(crate) height: f64,
    pub(crate) thickness: f64,
    /// Radius of a leg at the floor.
    pub(crate) leg: f64,
}

/// A table top on four legs that widen towards it.
pub(crate) fn table(stage: &mut Stage, stand: &Stand, top: &Top, board: Material, legs: Material) {
    let under = top.height - top.thickness;
    let size = [top.width, top.depth, top.thickness];
    stage.block(stand, [0.0, 0.0, top.height - 0.5 * top.thickness], size, board);
    for x in [-1.0, 1.0] {
        for y in [-1.0, 1.0] {
            let (x, y) = (x * (0.5 * top.width - 0.06), y * (0.5 * top.depth - 0.06));
            stage.cone(stand, [x * 1.03, y * 1.03, 0.0], [x, y, under], [top.leg, 1.5 * top.leg], legs);
        }
    }
    if top.thickness > 0.02 {
        for y in [-1.0, 1.0] {
            let y = y * (0.5 * top.depth - 0.07);
            stage.block(stand, [0.0, y, under - 0.04], [top.width - 0.16, 0.02, 0.08], board);
        }
    }
}

/// A monitor on its foot, keyboard and mouse, on a desk whose top is the stand's z = 0.
pub(crate) fn computer(stage: &mut Stage, stand: &Stand, seed: f64) {
    let (black, grey) = (Material::plain(0.06, 0.06, 0.07).gloss(0.3), metal(0.45));
    stage.block(stand, [0.0, 0.12, 0.008], [0.24, 0.17, 0.016], grey);
    stage.rod(stand, [0.0, 0.14, 0.0], [0.0, 0.14, 0.2], 0.016, grey);
    stage.block(stand, [0.0, 0.11, 0.31], [0.6, 0.03, 0.35], black);
    let lit = Material::new(Texture::Screen(seed)).glow(0.9);
    stage.block(stand, [0.0, 0.094, 0.315], [0.57, 0.004, 0.32], lit);
    stage.tilted(stand, [0.0, -0.16, 0.012], [0.42, 0.13, 0.016], lean(3.0, 0.0), black);
    let keys = [rgb(0.32, 0.32, 0.34), rgb(0.28, 0.28, 0.30), rgb(0.06, 0.06, 0.06)];
    let key = Material::new(Texture::Tiles(keys, 0.019));
    stage.tilted(stand, [0.0, -0.16, 0.022], [0.4, 0.115, 0.006], lean(3.0, 0.0), key);
    stage.ellipsoid(stand, [0.31, -0.15, 0.01], [0.032, 0.055, 0.022], lean(0.0, 10.0), black);
}
