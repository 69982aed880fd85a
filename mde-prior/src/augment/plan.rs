use serde::{Deserialize, Serialize};

/// Number of predictions of the augmentation: `"auto"`, or an upper bound.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(try_from = "Repr", rename_all = "kebab-case")]
pub enum Predictions {
    /// As many as the sizes of image and model make worthwhile; see [`Plan`].
    #[default]
    Auto,
    /// At most so many, 1 or more.
    #[serde(untagged)]
    Most(u32),
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Repr {
    Most(u32),
    Auto(String),
}

impl TryFrom<Repr> for Predictions {
    type Error = String;

    fn try_from(repr: Repr) -> Result<Self, String> {
        match repr {
            Repr::Most(most) => most.to_string().parse(),
            Repr::Auto(text) => text.parse(),
        }
    }
}

impl std::str::FromStr for Predictions {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match (text, text.parse()) {
            ("auto", _) => Ok(Self::Auto),
            (_, Ok(most @ 1..)) => Ok(Self::Most(most)),
            _ => Err(format!("{text:?} is no number of predictions; give \"auto\", or 1 or more")),
        }
    }
}

/// The images that are predicted: the whole image, crops level by level, and with `mirror` the mirror image of each.
///
/// Level `n` has n x n crops whose sides are 2 / n of the image's (3 / 4 for n = 2), so that neighbours overlap by half and more.
/// With \\(r\\) the geometric mean of the ratios of the image's sides to the model's [input](crate::DepthPrior::resolution), crops have sides
/// of \\(1/2r\\) and more: the model gets none with less than half its pixels along a side. Without a known input \\(r = 2.5\\). Plans
/// have 1, 2, 5, 10, 14, 28, 30, 60, 110, ... predictions.
///
/// [`Predictions::Auto`] takes the largest plan whose predictions have at most five times the pixels of the image in all, of 10 to 60
/// predictions. It ends at a level that moves the map by less (root mean square) than its predictions differ among themselves.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Plan {
    /// Whether the mirror image of every image is predicted too.
    pub mirror: bool,
    /// `n` of each level, from wide to narrow.
    pub levels: Vec<usize>,
    /// \\(r\\), where the model's input is known.
    pub ratio: Option<f64>,
}

/// \\(r\\) where the input's size is unknown.
const USUAL_RATIO: f64 = 2.5;
/// Most pixels that [`Predictions::Auto`] predicts, as a multiple of the image's.
const MOST_PIXELS: f64 = 5.0;
/// Fewest and most predictions of [`Predictions::Auto`], where there are crops for them.
const FEWEST: usize = 10;
const MOST: usize = 60;
/// Least side of a crop over that of the model's input.
const LEAST: f64 = 0.5;
/// Last level of a plan without mirror images: from there on they are worth more than another level.
const LAST_PLAIN: usize = 4;

/// Sides of the crops of level n, as a fraction of the image's.
pub(super) fn side(n: usize) -> f64 {
    if n <= 2 { 0.75 } else { 2.0 / n as f64 }
}

impl Plan {
    /// The plan for an image of `(height, width)` that the model takes at `input`.
    #[must_use]
    pub fn new(predictions: Predictions, image: (usize, usize), input: Option<(usize, usize)>) -> Self {
        let known = input.map(|input| {
            let times = |image: usize, input: usize| image as f64 / input.max(1) as f64;
            (times(image.0, input.0) * times(image.1, input.1)).sqrt()
        });
        let ratio = known.unwrap_or(USUAL_RATIO);
        let most = match predictions {
            Predictions::Auto => ((MOST_PIXELS * ratio * ratio) as usize).clamp(FEWEST, MOST),
            Predictions::Most(most) => most as usize,
        };
        // More crops than pixels along an axis would repeat themselves; more than 2^21 in all are never predicted.
        let finest = image.0.min(image.1).min(128);
        let levels = (2..=finest).take_while(|n| side(*n) * ratio >= LEAST).collect();
        Self { mirror: true, levels, ratio: known }.at_most(most)
    }

    /// The plan without its last levels, or without mirror images, so that it has at most `predictions`.
    fn at_most(&self, predictions: usize) -> Self {
        let plan =
            |mirror, levels| Self { mirror, levels: self.levels[..levels].to_vec(), ratio: self.ratio };
        let all = (0..=self.levels.len()).flat_map(|n| [plan(false, n), plan(true, n)]);
        let worthwhile = all.filter(|plan| plan.mirror || plan.levels.iter().all(|n| *n <= LAST_PLAIN));
        let most = predictions.min(self.predictions());
        let fitting = worthwhile.filter(|plan| plan.predictions() <= most);
        fitting.max_by_key(Self::predictions).unwrap_or_else(|| plan(false, 0))
    }

    /// Number of predictions.
    #[must_use]
    pub fn predictions(&self) -> usize {
        let crops: usize = self.levels.iter().map(|n| n * n).sum();
        (1 + crops) * if self.mirror { 2 } else { 1 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn plans_are_those_of_the_sizes_of_image_and_model() {
        let auto = |image, input| Plan::new(Predictions::Auto, image, Some(input));
        // FastDepth, a network of 48 x 48, and Depth Anything, whose input has more pixels than the image.
        assert_eq!(auto((480, 640), (224, 224)).levels, [2, 3, 4]);
        assert_eq!(auto((480, 640), (224, 224)).predictions(), 30);
        assert_eq!(auto((480, 640), (48, 48)).predictions(), 60);
        let anything = auto((480, 640), (518, 686));
        assert_eq!((anything.mirror, anything.levels), (true, vec![2]));
        assert_eq!(auto((1060, 1414), (518, 686)).levels, [2, 3]);
        // Three quarters of this image are fewer than half the model's pixels.
        assert_eq!(auto((240, 320), (518, 686)).predictions(), 2);
        assert_eq!(Plan::new(Predictions::Auto, (480, 640), None).levels, [2, 3, 4]);
        let at_most = |most| Plan::new(Predictions::Most(most), (960, 960), Some((96, 96))).predictions();
        let steps = [1, 2, 4, 5, 10, 14, 27, 28, 59, 60, 120].map(at_most);
        assert_eq!(steps, [1, 2, 2, 5, 10, 14, 14, 28, 30, 60, 110]);
        let all = |predictions| Plan::new(predictions, (480, 640), Some((448, 640))).predictions();
        assert_eq!([Predictions::Most(21), Predictions::Most(100)].map(all), [14, 60]);
    }

    proptest! {
        /// The number of predictions of a plan, as an upper bound, gives the plan again: a run repeats from its record.
        #[test]
        fn a_plan_repeats_from_its_number(height in 1..3000_usize, width in 1..3000_usize, input in 1..800_usize, most in 1..300_u32, cut in 1..300_usize) {
            for wanted in [Predictions::Auto, Predictions::Most(most)] {
                let plan = Plan::new(wanted, (height, width), Some((input, input))).at_most(cut);
                prop_assert!(plan.predictions() <= cut.max(1));
                let again = Plan::new(Predictions::Most(plan.predictions() as u32), (height, width), Some((input, input)));
                prop_assert_eq!(plan, again);
            }
        }
    }
}
