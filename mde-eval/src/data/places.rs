use super::{DataSet, Sample};
use crate::{Error, Result};
use mde_uncertainty::OutOfRange;
use std::collections::BTreeMap;

/// A data set whose scenes show the places of a list: for data sets without a record of which images are of one room.
pub struct Placed {
    data: Box<dyn DataSet>,
    /// By index of the scene.
    places: Vec<Option<String>>,
}

/// Reads a list of places: a line per scene with its identifier, white space, and the name of its place. Empty lines and lines
/// that begin with `#` are ignored.
///
/// # Errors
/// [`Error::Config`] for a line without both, and for a scene that stands there twice.
pub fn parse_places(text: &str) -> Result<BTreeMap<String, String>> {
    let mut places = BTreeMap::new();
    for line in text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#')) {
        let fault = |remedy| Err(OutOfRange::new("a line of the places", format!("`{line}`"), remedy).into());
        let Some((scene, place)) = line.split_once(char::is_whitespace) else {
            return fault("write a scene, white space, and its place");
        };
        if places.insert(scene.to_owned(), place.trim().to_owned()).is_some() {
            return fault("give each scene once");
        }
    }
    Ok(places)
}

impl Placed {
    /// The scenes of `data` at the places by identifier; scenes that are not listed keep their own.
    ///
    /// # Errors
    /// [`Error::Unknown`] for a scene that the data set does not have.
    pub fn new(data: Box<dyn DataSet>, places: &BTreeMap<String, String>) -> Result<Self> {
        if let Some(unknown) = places.keys().find(|scene| !data.ids().contains(scene)) {
            let known = data.ids().iter().take(5).cloned().collect::<Vec<_>>().join(", ") + ", ...";
            return Err(Error::Unknown { what: "scene", name: unknown.clone(), known });
        }
        let places = data.ids().iter().map(|id| places.get(id).cloned()).collect();
        Ok(Self { data, places })
    }
}

impl DataSet for Placed {
    fn ids(&self) -> &[String] {
        self.data.ids()
    }

    fn place(&self, index: usize) -> Option<&str> {
        self.places.get(index)?.as_deref().or_else(|| self.data.place(index))
    }

    fn load(&self, index: usize) -> Result<Sample> {
        self.data.load(index)
    }
}
