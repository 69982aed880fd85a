//! Rerun's file format: entities with a history, one Arrow table a chunk.

use crate::program::recording::watched::Watched;
use crate::program::store::folder::check_new_file;
use anyhow::{Context, Result, ensure};
use crate::output::record::TrainingCurve;
use crate::output::export::Exported;
use crate::several::Capture;
use crate::reports::capture::CaptureReport;
use crate::reports::iteration::IterationReport;
use mde_nerf::RadianceField;
use mde_prior::photo::encode_rgb_png;
use mde_uncertainty::GaussianDepth;
use mde_warp::{PinholeCamera, Pose, PosedView};
use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion};
use ndarray::{ArrayView2, ArrayView3};
use re_chunk::{Chunk, ChunkBuilder, EntityPath, TimePoint, Timeline};
use re_log_encoding::Encoder;
use re_log_types::{LogMsg, SetStoreInfo, StoreId, StoreInfo, StoreKind, StoreSource};
use re_sdk_types::archetypes::{
    DepthImage, EncodedImage, Pinhole, Points3D, RecordingInfo, Scalars, TextDocument, Transform3D,
    ViewCoordinates,
};
use re_sdk_types::components::Colormap;
use re_sdk_types::datatypes::ChannelDatatype;
use re_sdk_types::{AsComponents, RowId};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Rerun counts pixel centres from one half, we from zero.
const HALF: f64 = 0.5;

/// The recording so far, shared by the stages of the loop.
#[derive(Clone)]
pub(crate) struct Recording(Arc<Mutex<Stream>>);

struct Stream {
    path: PathBuf,
    store: StoreId,
    encoder: Encoder<Vec<u8>>,
    /// Steps of all fits so far.
    steps: usize,
    /// The first error; it does not fail a stage.
    failure: Option<anyhow::Error>,
}

/// On both of the recording's clocks.
fn at(iteration: usize, step: usize) -> TimePoint {
    let clock = |time: TimePoint, name: &'static str, index: usize| {
        time.with(Timeline::new_sequence(name), i64::try_from(index).unwrap_or(i64::MAX))
    };
    clock(clock(TimePoint::default(), "iteration", iteration), "step", step)
}

impl Recording {
    /// Checks that the file can be written at the end.
    pub(crate) fn new(path: &Path, force: bool) -> Result<Self> {
        let named = path.extension().is_some_and(|extension| extension == "rrd");
        ensure!(
            named,
            "--rerun {}: the viewer recognises recordings by the extension; give a name that ends in .rrd",
            path.display()
        );
        check_new_file("--rerun", path, force)?;
        let store = StoreId::random(StoreKind::Recording, "mde");
        let mut encoder = Encoder::local()?;
        encoder.append(&LogMsg::SetStoreInfo(SetStoreInfo {
            row_id: *RowId::new(),
            info: StoreInfo::new(store.clone(), StoreSource::Other("mde".to_owned())),
        }))?;
        Ok(Self(Arc::new(Mutex::new(Stream {
            path: path.to_owned(),
            store,
            encoder,
            steps: 0,
            failure: None,
        }))))
    }

    /// The photograph, its name and camera, the prior and the settings; may be called at any time.
    pub(crate) fn inputs(&self, name: &str, scene: &Exported<'_>, settings: &str) {
        let always = TimePoint::default;
        self.log(EntityPath::properties(), always(), &RecordingInfo::new().with_name(name));
        self.log("settings", always(), &TextDocument::from_markdown(format!("```toml\n{settings}\n```")));
        self.log("world", always(), &ViewCoordinates::RDF());
        self.log("world/camera", always(), &pinhole(scene.camera));
        self.picture("world/camera/image", always(), scene.image, None);
        self.shape(at(0, 0), scene);
    }

    /// The depth after `iteration` iterations.
    pub(crate) fn depth(&self, iterations: usize, scene: &Exported<'_>) {
        self.shape(self.now(iterations), scene);
    }

    /// A cloud, and a map beside the world, where the viewer would make a second cloud of it.
    fn shape(&self, when: TimePoint, scene: &Exported<'_>) {
        self.log("depth", when.clone(), &map(scene.depth.mean(), Colormap::Turbo));
        let (rows, columns) = scene.depth.dim();
        let pixels = (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column)));
        let known = pixels.filter_map(|(row, column)| {
            let point = scene.point(row, column)?;
            Some(([point.x as f32, point.y as f32, point.z as f32], scene.colour(row, column)))
        });
        let (points, colours): (Vec<_>, Vec<_>) = known.unzip();
        self.log("world/cloud", when, &Points3D::new(points).with_colors(colours));
    }

    /// The standard deviation after `iteration` iterations.
    pub(crate) fn sigma(&self, iterations: usize, depth: &GaussianDepth) {
        self.log("sigma", self.now(iterations), &map(depth.sigma().view(), Colormap::Magma));
    }

    /// A field that also records its steps and, with `views`, what it is fitted to.
    pub(crate) fn watch(
        &self,
        iteration: usize,
        views: bool,
        field: Box<dyn RadianceField>,
    ) -> Box<dyn RadianceField> {
        Box::new(Watched { field, iteration, views, recording: self.clone() })
    }

    /// The further photographs that were used and their cameras, in the unit of the depth; may be called at any time.
    pub(crate) fn photographs(&self, capture: &Capture, report: &CaptureReport) {
        for (index, (photograph, found)) in capture.photographs.iter().zip(&report.photographs).enumerate() {
            let (Some(rows), Some(camera)) = (found.pose, found.camera) else { continue };
            if index == capture.reference {
                continue;
            }
            let entity = format!("world/photographs/{index:02}");
            self.log(entity.as_str(), TimePoint::default(), &placed(&pose(rows)));
            self.log(entity.as_str(), TimePoint::default(), &pinhole(&camera));
            let mask = Some(photograph.mask.view());
            self.picture(&format!("{entity}/image"), TimePoint::default(), photograph.image.view(), mask);
        }
    }

    /// The training views of an iteration (from 1).
    pub(super) fn views(&self, iteration: usize, views: &[PosedView]) {
        let when = self.now(iteration);
        // The first is the photograph itself.
        for (index, view) in views.iter().enumerate().skip(1) {
            let entity = format!("world/views/{index:02}");
            self.log(entity.as_str(), when.clone(), &placed(&view.pose));
            self.log(entity.as_str(), when.clone(), &pinhole(&view.camera));
            self.picture(&format!("{entity}/image"), when.clone(), view.image.view(), Some(view.mask.view()));
        }
    }

    /// `steps` more steps have been taken.
    pub(crate) fn fitted(&self, steps: usize) {
        self.stream().steps += steps;
    }

    /// The estimates of every iteration, and the curves of its fit.
    pub(crate) fn reports(&self, iterations: &[IterationReport], training: &[TrainingCurve]) {
        // What was fitted before an interruption left no curve.
        let resumed = iterations.len().saturating_sub(training.len());
        if let ([], [curve]) = (iterations, training) {
            // The fit to several photographs.
            self.curve(curve, 1, 0);
        }
        let mut before = 0;
        for (index, IterationReport { fit, fusion, .. }) in iterations.iter().enumerate() {
            let iteration = index + 1;
            if let Some(curve) = index.checked_sub(resumed).and_then(|index| training.get(index)) {
                self.curve(curve, iteration, before);
            }
            before += fit.steps;
            for (name, value) in [
                ("a", fusion.a),
                ("b", fusion.b),
                ("sigma_o", fusion.sigma_o),
                ("nerf_weight", fusion.nerf_weight),
            ] {
                self.log(format!("fusion/{name}"), at(iteration, before), &Scalars::single(value));
            }
        }
    }

    /// The curve of a fit that began after `before` steps.
    fn curve(&self, curve: &TrainingCurve, iteration: usize, before: usize) {
        for (name, values) in [("loss", &curve.loss), ("psnr", &curve.psnr)] {
            self.append(format!("training/{name}"), |chunk| {
                let rows = curve.step.iter().zip(values);
                rows.fold(chunk, |chunk, (step, value)| {
                    chunk.with_archetype_auto_row(at(iteration, before + step), &Scalars::single(*value))
                })
            });
        }
    }

    /// Writes the file.
    pub(crate) fn save(&self) -> Result<()> {
        let mut stream = self.stream();
        let name = format!("--rerun {}", stream.path.display());
        if let Some(failure) = stream.failure.take() {
            return Err(failure.context(format!("{name}: the recording can't be made")));
        }
        stream.encoder.finish().with_context(|| name.clone())?;
        let encoder = std::mem::replace(&mut stream.encoder, Encoder::local()?);
        let bytes = encoder.into_inner().with_context(|| name.clone())?;
        if let Some(parent) = stream.path.parent() {
            std::fs::create_dir_all(parent).with_context(|| name.clone())?;
        }
        mde_prior::write_atomic(&stream.path, &bytes).context(name)
    }

    /// Black where the mask is false.
    fn picture(
        &self,
        entity: &str,
        when: TimePoint,
        image: ArrayView3<'_, f32>,
        mask: Option<ArrayView2<'_, bool>>,
    ) {
        let mut pixels = image.mapv(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8);
        for ((row, column), _) in mask.iter().flat_map(|mask| mask.indexed_iter()).filter(|(_, real)| !**real)
        {
            (0..3).for_each(|channel| pixels[(row, column, channel)] = 0);
        }
        match encode_rgb_png(pixels.view()) {
            Ok(png) => self.log(entity, when, &EncodedImage::from_file_contents(png)),
            Err(error) => self.fail(error.into()),
        }
    }

    fn log(&self, entity: impl Into<EntityPath>, when: TimePoint, what: &dyn AsComponents) {
        self.append(entity, |chunk| chunk.with_archetype_auto_row(when, what));
    }

    fn append(&self, entity: impl Into<EntityPath>, rows: impl FnOnce(ChunkBuilder) -> ChunkBuilder) {
        let append = || -> Result<()> {
            let message = rows(Chunk::builder(entity)).build()?.to_arrow_msg()?;
            let mut stream = self.stream();
            let store = stream.store.clone();
            stream.encoder.append(&LogMsg::ArrowMsg(store, message))?;
            Ok(())
        };
        if let Err(error) = append() {
            self.fail(error);
        }
    }

    fn fail(&self, error: anyhow::Error) {
        self.stream().failure.get_or_insert(error);
    }

    /// After the steps so far.
    fn now(&self, iteration: usize) -> TimePoint {
        at(iteration, self.stream().steps)
    }

    fn stream(&self) -> MutexGuard<'_, Stream> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn pinhole(camera: &PinholeCamera) -> Pinhole {
    let [fx, fy] = [camera.fx, camera.fy].map(|v| v as f32);
    let [cx, cy] = [camera.cx, camera.cy].map(|v| (v + HALF) as f32);
    // By columns.
    Pinhole::new([[fx, 0.0, 0.0], [0.0, fy, 0.0], [cx, cy, 1.0]])
        .with_resolution([camera.width as f32, camera.height as f32])
}

/// The pose of a world-to-camera matrix.
fn pose(rows: [[f64; 4]; 4]) -> Pose {
    let rotation = Matrix3::from_fn(|row, column| rows[row][column]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    Pose::from_parts(Translation3::new(rows[0][3], rows[1][3], rows[2][3]), rotation)
}

/// Where a camera stands.
fn placed(pose: &Pose) -> Transform3D {
    let camera_to_world = pose.inverse();
    let rotation = camera_to_world.rotation.to_rotation_matrix().cast::<f32>();
    let columns: [[f32; 3]; 3] = rotation.into_inner().into();
    let translation: [f32; 3] = camera_to_world.translation.vector.cast::<f32>().into();
    Transform3D::from_translation_mat3x3(translation, columns)
}

/// A map in the prior's unit; the viewer takes 0 for missing.
fn map(values: ArrayView2<'_, f32>, colours: Colormap) -> DepthImage {
    let (rows, columns) = values.dim();
    let bytes: Vec<u8> =
        values.iter().flat_map(|v| if v.is_finite() { *v } else { 0.0 }.to_le_bytes()).collect();
    DepthImage::from_data_type_and_bytes(bytes, [columns as u32, rows as u32], ChannelDatatype::F32)
        .with_meter(1.0)
        .with_colormap(colours)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mde_nerf::{FieldCallback, FitReport, RenderedView};
    use re_log_encoding::DecoderApp;
    use re_log_types::TimeInt;
    use std::collections::BTreeMap;

    const SIZE: (usize, usize) = (6, 8);

    fn with_plane(test: impl FnOnce(&Exported<'_>)) {
        let camera = PinholeCamera::new(10.0, 12.0, 3.5, 2.5, SIZE.1, SIZE.0).unwrap();
        let prior = ndarray::Array2::from_elem(SIZE, 2.0);
        let depth = GaussianDepth::new(prior.clone(), ndarray::Array2::from_elem(SIZE, 0.01)).unwrap();
        let image =
            ndarray::Array3::from_shape_fn((SIZE.0, SIZE.1, 3), |(v, u, c)| (v * 8 + u + c) as f32 / 50.0);
        test(&Exported {
            unit: "m",
            image: image.view(),
            camera: &camera,
            depth: &depth,
            prior: prior.view(),
            components: Vec::new(),
            certainty: None,
            y_up: false,
            png_scale: 1000.0,
        });
    }

    struct Wall;

    impl RadianceField for Wall {
        fn fit(&mut self, _: &[PosedView], _: &mut dyn FieldCallback) -> mde_nerf::Result<FitReport> {
            Ok(FitReport { steps: 30, ..FitReport::default() })
        }

        fn render(
            &self,
            _: &PinholeCamera,
            _: &Pose,
            _: &mut dyn FieldCallback,
        ) -> mde_nerf::Result<RenderedView> {
            Err(mde_nerf::Error::NotFitted)
        }
    }

    /// Entities of a recording with the steps at which something was logged.
    fn steps(path: &Path) -> BTreeMap<String, Vec<i64>> {
        let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
        let mut steps = BTreeMap::<String, Vec<i64>>::new();
        for message in DecoderApp::decode_lazy(file) {
            let LogMsg::ArrowMsg(_, message) = message.unwrap() else { continue };
            let chunk = Chunk::from_arrow_msg(&message).unwrap();
            let times = steps.entry(chunk.entity_path().to_string()).or_default();
            let column = chunk.timelines().get(&"step".into());
            times.extend(column.iter().flat_map(|column| column.times().map(TimeInt::as_i64)));
            times.sort_unstable();
        }
        steps
    }

    #[test]
    fn a_recording_is_read_back_with_its_clock() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("new/run.rrd");
        let recording = Recording::new(&path, false).unwrap();
        with_plane(|scene| {
            let views: Vec<_> = [0.0, 0.1]
                .map(|x| PosedView {
                    image: scene.image.to_owned(),
                    camera: *scene.camera,
                    pose: Pose::translation(x, 0.0, 0.0),
                    mask: ndarray::Array2::from_shape_fn(SIZE, |(row, _)| row > 0),
                    hypotheses: Vec::new(),
                })
                .into();
            for iteration in [1, 2] {
                recording.watch(iteration, true, Box::new(Wall)).fit(&views, &mut mde_nerf::Silent).unwrap();
                recording.depth(iteration, scene);
                recording.sigma(iteration, scene.depth);
            }
            // Known from the start, but recorded at the end.
            recording.inputs("plane", scene, "seed = 0");
        });
        let report = IterationReport::default();
        let fit = FitReport { steps: 30, ..FitReport::default() };
        let curve = TrainingCurve { step: vec![10, 30], loss: vec![0.2, 0.1], psnr: vec![7.0, 10.0] };
        let iterations = [0, 1].map(|_| IterationReport { fit: fit.clone(), ..report.clone() });
        // As after an interruption: the first iteration's curve is not there.
        recording.reports(&iterations, &[curve]);
        assert!(!path.exists());
        recording.save().unwrap();
        let expected = [
            ("/__properties", vec![]),
            ("/depth", vec![0, 30, 60]),
            ("/fusion/a", vec![30, 60]),
            ("/fusion/b", vec![30, 60]),
            ("/fusion/nerf_weight", vec![30, 60]),
            ("/fusion/sigma_o", vec![30, 60]),
            ("/settings", vec![]),
            ("/sigma", vec![30, 60]),
            ("/training/loss", vec![40, 60]),
            ("/training/psnr", vec![40, 60]),
            ("/world", vec![]),
            ("/world/camera", vec![]),
            ("/world/camera/image", vec![]),
            ("/world/cloud", vec![0, 30, 60]),
            ("/world/views/01", vec![0, 0, 30, 30]),
            ("/world/views/01/image", vec![0, 30]),
        ];
        assert_eq!(steps(&path), expected.map(|(entity, times)| (entity.to_owned(), times)).into());
    }

    #[test]
    fn what_cannot_be_written_is_refused_early() {
        let place = tempfile::tempdir().unwrap();
        let refused = |name: &str, force: bool| {
            Recording::new(&place.path().join(name), force).err().map(|error| error.to_string())
        };
        std::fs::write(place.path().join("old.rrd"), "").unwrap();
        std::fs::create_dir(place.path().join("folder.rrd")).unwrap();
        assert!(refused("run.png", true).unwrap().contains("ends in .rrd"));
        assert!(refused("old.rrd", false).unwrap().contains("--force"));
        assert!(refused("folder.rrd", true).unwrap().contains("is a folder"));
        assert!(refused("old.rrd/run.rrd", true).unwrap().contains("another place to --rerun"));
        assert_eq!(refused("old.rrd", true), None);
    }

    #[test]
    fn a_matrix_gives_its_pose_back() {
        let expected = Pose::new([0.1, -0.2, 0.3].into(), [0.3, 0.1, -0.2].into());
        let matrix = expected.to_homogeneous();
        let rows = std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]));
        assert!((pose(rows).to_homogeneous() - matrix).norm() < 1e-12);
    }

    #[test]
    fn a_camera_stands_where_its_pose_says() {
        let pose = Pose::new([0.1, -0.2, 0.3].into(), [0.3, 0.1, -0.2].into());
        let logged = placed(&pose);
        let matrix = logged.mat3x3.unwrap();
        let columns: re_sdk_types::components::TransformMat3x3 = {
            use re_sdk_types::Loggable as _;
            re_sdk_types::components::TransformMat3x3::from_arrow(&*matrix.array).unwrap()[0]
        };
        let centre = pose.inverse_transform_point(&nalgebra::Point3::origin());
        let ahead = pose.inverse_transform_point(&nalgebra::Point3::new(0.0, 0.0, 1.0));
        for (axis, value) in columns.0.0[6..].iter().enumerate() {
            assert!((f64::from(*value) - (ahead[axis] - centre[axis])).abs() < 1e-6);
        }
    }
}
