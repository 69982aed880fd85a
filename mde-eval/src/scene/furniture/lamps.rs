use crate::scene::stage::{Stage, Stand, enamel, metal};
use crate::scene::texture::Material;

/// A standing lamp on a thin pole, `h` high; a shade glows as its light does.
pub(crate) fn floor_lamp(stage: &mut Stage, stand: &Stand, h: f64, shade: Material) {
    let steel = metal(0.3);
    stage.rod(stand, [0.0, 0.0, 0.0], [0.0, 0.0, 0.022], 0.14, steel);
    stage.rod(stand, [0.0, 0.0, 0.02], [0.0, 0.0, h - 0.22], 0.011, steel);
    stage.cone(stand, [0.0, 0.0, h - 0.28], [0.0, 0.0, h], [0.21, 0.14], shade);
    stage.rod(stand, [0.09, 0.0, h - 0.28], [0.09, 0.0, h - 0.42], 0.002, steel);
    stage.ball(stand, [0.09, 0.0, h - 0.43], 0.009, steel);
}

/// A lamp with a bulging foot.
pub(crate) fn table_lamp(stage: &mut Stage, stand: &Stand, h: f64, shade: Material, foot: Material) {
    stage.ball(stand, [0.0, 0.0, 0.085], 0.085, foot);
    stage.rod(stand, [0.0, 0.0, 0.1], [0.0, 0.0, h - 0.15], 0.01, metal(0.6));
    stage.cone(stand, [0.0, 0.0, h - 0.19], [0.0, 0.0, h], [0.14, 0.085], shade);
}

/// A lamp on two arms with joints.
pub(crate) fn desk_lamp(stage: &mut Stage, stand: &Stand) {
    let red = enamel(0.72, 0.16, 0.12);
    stage.rod(stand, [0.0, 0.0, 0.0], [0.0, 0.0, 0.02], 0.085, red);
    let joints = [[0.0, 0.0, 0.02], [-0.1, 0.05, 0.3], [0.12, -0.06, 0.5]];
    for pair in joints.windows(2) {
        stage.rod(stand, pair[0], pair[1], 0.007, metal(0.6));
        stage.ball(stand, pair[1], 0.015, red);
    }
    stage.cone(stand, joints[2], [0.17, -0.1, 0.41], [0.025, 0.075], red);
}

/// A lamp hanging from the ceiling at `ceiling` by a thin cord.
pub(crate) fn pendant(stage: &mut Stage, stand: &Stand, ceiling: f64, h: f64, shade: Material) {
    stage.rod(stand, [0.0, 0.0, h], [0.0, 0.0, ceiling], 0.004, Material::plain(0.1, 0.1, 0.1));
    stage.rod(stand, [0.0, 0.0, ceiling - 0.03], [0.0, 0.0, ceiling], 0.05, metal(0.5));
    stage.cone(stand, [0.0, 0.0, h - 0.22], [0.0, 0.0, h], [0.2, 0.05], shade);
}
