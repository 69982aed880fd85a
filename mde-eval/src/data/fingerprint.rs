use super::Sample;
use ndarray::Array2;

impl Sample {
    /// Checksum (CRC-32) of the image, its camera, its own prior, the further photographs with theirs and, where given, a depth map.
    pub fn fingerprint(&self, depth: Option<&Array2<f32>>) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        let views = || self.views.iter().map(|captured| &captured.view);
        for camera in views().map(|view| &view.camera).chain([&self.camera]) {
            for number in [camera.fx, camera.fy, camera.cx, camera.cy] {
                hasher.update(&number.to_le_bytes());
            }
        }
        for view in views() {
            view.pose.to_homogeneous().iter().for_each(|number| hasher.update(&number.to_le_bytes()));
            view.image.iter().for_each(|value| hasher.update(&value.to_le_bytes()));
        }
        for prior in self.views.iter().map(|captured| &captured.prior).chain([&self.prior]).flatten() {
            hasher.update(prior.kind.to_string().as_bytes());
            let known = prior.map.iter().zip(&prior.valid);
            known.for_each(|(value, valid)| hasher.update(&if *valid { *value } else { 0.0 }.to_le_bytes()));
        }
        for value in self.image.iter().chain(depth.into_iter().flatten()) {
            hasher.update(&value.to_le_bytes());
        }
        hasher.update(format!("{:?}", self.image.dim()).as_bytes());
        hasher.finalize()
    }
}
