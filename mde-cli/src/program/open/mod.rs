//! From the command line to a prior, settings and scenes.

pub(crate) mod photographs;
pub(crate) mod prior;
pub(crate) mod relative;
pub(crate) mod scene;
pub(crate) mod settings;
pub(crate) mod truth;

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use crate::config::Preset;
    #[cfg(feature = "onnx")]
    use crate::prior::OpenPrior;
    use crate::program::args::NetworkArgs;
    use crate::program::open::photographs::content;
    use crate::refiner::error_bar::ErrorBar;
    use crate::scene::camera::{GivenCamera, KnownCamera};
    use crate::scene::known::KnownDepths;
    use std::path::Path;

    /// A named pipe that nobody writes to would hang a reader.
    #[test]
    fn a_pipe_in_the_place_of_a_file_is_refused_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for name in ["p", "p.toml", "p.npy", "p.png", "p.txt", "p.csv"] {
            assert!(std::process::Command::new("mkfifo").arg(path(name)).status().unwrap().success());
        }
        let text = |name: &str| path(name).display().to_string();
        let refused = |error: anyhow::Error| {
            let shown = format!("{error:#}");
            assert!(shown.contains("it is a named pipe") && shown.contains("give a "), "{shown}");
            shown
        };
        let settings = refused(settings::overridden(Preset::Default, &[text("p.toml").into()]).unwrap_err());
        assert!(settings.contains("p.toml") && settings.contains("give a regular file"), "{settings}");
        refused(ErrorBar::open(None, Some(&path("p.toml"))).unwrap_err().into());
        let camera = GivenCamera::File(path("p"));
        refused(KnownCamera::new(&camera, None, [64, 48]).unwrap_err().into());
        let known = KnownDepths::open(&path("p.csv"), Path::new("a.jpg"), (48, 64));
        refused(known.unwrap_err().into());
        for map in ["p.npy", "p.png"] {
            refused(prior::map(&path(map), &NetworkArgs::default()).err().unwrap());
        }
        refused(photographs::all(&[&path("p.txt")]).unwrap_err());
        refused(mde_prior::photo::read_image(path("p.png")).unwrap_err().into());
        refused(content(&path("p.png")).unwrap_err());
        assert_eq!(scene::size(&path("p.png")).unwrap(), (1, 1));
        #[cfg(feature = "onnx")]
        {
            let profile = text("p.toml");
            let network = OpenPrior::network(&path("p"), Some(&profile), None, &mde_prior::Runtime::Tract);
            refused(network.err().unwrap().into());
        }
    }
}
