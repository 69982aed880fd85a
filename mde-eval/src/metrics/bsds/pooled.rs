use super::super::edges::harmonic;
use super::{BoundaryCounts, THRESHOLDS};
use crate::{Error, Result};

/// Sums over images.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    truth: u64,
    predicted: u64,
    matched: u64,
}

impl Sums {
    fn of(image: &BoundaryCounts, k: usize) -> Self {
        let [truth, predicted, matched] = [image.truth, image.predicted[k], image.matched[k]].map(u64::from);
        Self { truth, predicted, matched }
    }

    fn add(&mut self, other: Self) {
        self.truth += other.truth;
        self.predicted += other.predicted;
        self.matched += other.matched;
    }

    fn precision(self) -> f64 {
        self.share(self.predicted)
    }

    fn recall(self) -> f64 {
        self.share(self.truth)
    }

    fn f1(self) -> f64 {
        harmonic(self.precision(), self.recall())
    }

    fn share(self, of: u64) -> f64 {
        if of == 0 { 0.0 } else { self.matched as f64 / of as f64 }
    }
}

/// \\(F_1\\) at the one threshold that is best for all images together (BSDS's "ODS"), of counts pooled over images; nothing without
/// images.
///
/// # Errors
/// [`Error::Length`] where an image was counted at other thresholds.
pub fn ods<'c>(images: impl IntoIterator<Item = &'c BoundaryCounts>) -> Result<Option<f64>> {
    Ok(pool(images)?.map(|pooled| pooled.iter().map(|sums| sums.f1()).fold(0.0, f64::max)))
}

/// \\(F_1\\) of counts pooled over images, each at the threshold that is best for it (BSDS's "OIS"); nothing without images.
///
/// Unlike the mean of [`BoundaryCounts::best`], images with more boundaries count for more.
///
/// # Errors
/// As [`ods`].
pub fn ois<'c>(images: impl IntoIterator<Item = &'c BoundaryCounts>) -> Result<Option<f64>> {
    let mut pooled: Option<Sums> = None;
    for image in images {
        check(image)?;
        let mut best = Sums::of(image, 0);
        for sums in (1..THRESHOLDS.len()).map(|k| Sums::of(image, k)) {
            if sums.f1() > best.f1() {
                best = sums;
            }
        }
        pooled.get_or_insert_default().add(best);
    }
    Ok(pooled.map(Sums::f1))
}

/// Area under precision over recall of counts pooled over images, as average precision over [`THRESHOLDS`],
/// \\(\sum_k (R_k - R_{k-1}) P_k\\); nothing without images.
///
/// # Errors
/// As [`ods`].
pub fn average_precision<'c>(images: impl IntoIterator<Item = &'c BoundaryCounts>) -> Result<Option<f64>> {
    let area = |pooled: [Sums; THRESHOLDS.len()]| {
        let mut recall = 0.0;
        let pieces = pooled.into_iter().rev().map(|sums| {
            let gained = sums.recall() - recall;
            recall = sums.recall();
            gained * sums.precision()
        });
        pieces.sum()
    };
    Ok(pool(images)?.map(area))
}

/// Counts at each threshold over all images; nothing without images.
fn pool<'c>(
    images: impl IntoIterator<Item = &'c BoundaryCounts>,
) -> Result<Option<[Sums; THRESHOLDS.len()]>> {
    let mut pooled: Option<[Sums; THRESHOLDS.len()]> = None;
    for image in images {
        check(image)?;
        for (k, sums) in pooled.get_or_insert([Sums::default(); THRESHOLDS.len()]).iter_mut().enumerate() {
            sums.add(Sums::of(image, k));
        }
    }
    Ok(pooled)
}

fn check(image: &BoundaryCounts) -> Result<()> {
    for (what, list) in [("the predicted counts", &image.predicted), ("the matched counts", &image.matched)] {
        if list.len() != THRESHOLDS.len() {
            return Err(Error::Length { what, found: list.len(), expected: THRESHOLDS.len() });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn image() -> impl Strategy<Value = BoundaryCounts> {
        let steps = proptest::collection::vec((0..9_u32, 0..9_u32), THRESHOLDS.len());
        (steps, 0..50_u32).prop_map(|(steps, missed)| {
            let (mut predicted, mut matched) = (vec![0; THRESHOLDS.len()], vec![0; THRESHOLDS.len()]);
            let (mut all, mut hits) = (0, 0);
            for (k, (more, of_them)) in steps.into_iter().enumerate().rev() {
                all += more;
                hits += of_them.min(more);
                (predicted[k], matched[k]) = (all, hits);
            }
            BoundaryCounts { truth: hits + missed + 1, predicted, matched, best: 0.0, average_precision: 0.0 }
        })
    }

    proptest! {
        #[test]
        fn of_one_image_its_own_threshold_is_the_one_for_all(image in image(), copies in 1..4_usize) {
            let images = vec![&image; copies];
            let (shared, own) = (ods(images.clone()).unwrap().unwrap(), ois(images).unwrap().unwrap());
            prop_assert!((shared - own).abs() < 1e-12);
        }

        #[test]
        fn all_lie_between_nothing_and_perfect(images in proptest::collection::vec(image(), 1..5)) {
            let area = average_precision(&images).unwrap().unwrap();
            let scores = [ods(&images).unwrap().unwrap(), ois(&images).unwrap().unwrap(), area];
            prop_assert!(scores.iter().all(|s| (0.0..=1.0).contains(s)), "{scores:?}");
        }
    }

    #[test]
    fn no_images_and_other_thresholds() {
        assert_eq!((ods([]).unwrap(), ois([]).unwrap(), average_precision([]).unwrap()), (None, None, None));
        let few = BoundaryCounts {
            truth: 3,
            predicted: vec![2],
            matched: vec![1],
            best: 0.4,
            average_precision: 0.2,
        };
        for wrong in [ods([&few]), ois([&few]), average_precision([&few])] {
            assert!(matches!(wrong, Err(Error::Length { found: 1, .. })));
        }
    }
}
