use crate::args::RefineArgs;
use crate::camera::KnownCamera;
use crate::job::{Job, open_image, settings, use_threads};
use crate::output::OutputFolder;
use crate::prior::NamedPrior;
use crate::progress::Progress;
use crate::truth::Truth;
use anyhow::Result;

pub(super) fn run(args: &RefineArgs) -> Result<()> {
    let mut progress = Progress::new(&args.run);
    use_threads(&args.run)?;
    let folder = OutputFolder::new(&args.run.output, args.run.force)?;
    let (preset, config) = settings(&args.settings)?;
    let photo = open_image(&args.image, &mut progress)?;
    let (height, width, _) = photo.pixels.dim();
    let camera = KnownCamera::new(&args.camera, photo.focal_35mm, [width, height])?;
    if let Some(warning) = camera.warning() {
        progress.warn(warning);
    }
    let job = Job {
        command: "refine",
        input: args.image.display().to_string(),
        camera,
        prior: NamedPrior::open(&args.prior)?,
        preset,
        config,
        truth: Truth::open(&args.truth, (height, width))?,
        save_field: args.save_field,
        export: args.export.export.clone(),
        image: photo.pixels,
    };
    job.run(&folder, &mut progress)
}
