use super::*;
use crate::synthetic::{Plane, pose_at, render};
use mde_warp::PinholeCamera;
use proptest::prelude::*;

/// The cost in `f64`, straight from the definition; nothing where a window comes near the source's edge.
fn reference_cost(setup: &Setup<'_>, x: usize, y: usize, multiple: f32) -> Option<f64> {
    let (h, w) = setup.reference.camera.dim();
    let grey = luma(setup.reference.image.view());
    let r = RADIUS;
    let mut costs = Vec::new();
    for source in setup.sources {
        let transfer = Transfer::new(setup.reference, source);
        let there = luma(source.image.view());
        let (bottom, right) = ((there.nrows() - 1) as f64, (there.ncols() - 1) as f64);
        let (mut a, mut b) = (Vec::new(), Vec::new());
        let mut outside = false;
        for v in y.saturating_sub(r)..(y + r + 1).min(h) {
            for u in x.saturating_sub(r)..(x + r + 1).min(w) {
                let inverse = f64::from(setup.centre[v * w + u] * multiple);
                let seen = transfer.at(u as f64, v as f64, inverse)?;
                let margin = seen.x.min(seen.y).min(right - seen.x).min(bottom - seen.y);
                if margin.abs() < 1e-3 {
                    return None;
                }
                if margin < 0.0 {
                    outside = true;
                    continue;
                }
                let (x0, y0) = (seen.x as usize, seen.y as usize);
                let (fx, fy) = (seen.x - x0 as f64, seen.y - y0 as f64);
                let at = |y: usize, x: usize| f64::from(there[(y, x)]);
                let top = at(y0, x0) + fx * (at(y0, x0 + 1) - at(y0, x0));
                let low = at(y0 + 1, x0) + fx * (at(y0 + 1, x0 + 1) - at(y0 + 1, x0));
                a.push(f64::from(grey[(v, u)]));
                b.push(top + fy * (low - top));
            }
        }
        if outside {
            continue;
        }
        let n = a.len() as f64;
        let mean = |v: &[f64]| v.iter().sum::<f64>() / n;
        let (ma, mb) = (mean(&a), mean(&b));
        let product = |p: &[f64], mp: f64, q: &[f64], mq: f64| {
            p.iter().zip(q).map(|(x, y)| (x - mp) * (y - mq)).sum::<f64>() / n
        };
        let noise = f64::from(NOISE).powi(2);
        let scale = ((product(&a, ma, &a, ma) + noise) * (product(&b, mb, &b, mb) + noise)).sqrt();
        costs.push(1.0 - product(&a, ma, &b, mb) / scale);
    }
    costs.sort_by(f64::total_cmp);
    costs.iter_mut().for_each(|c| *c = c.clamp(0.0, 1.0));
    let kept = costs.len().div_ceil(2);
    (kept > 0).then(|| costs[..kept].iter().sum::<f64>() / kept as f64)
}

/// A slanted plane by a first photograph of that size and others of these places and angles, and surfaces about its depth.
fn with_setup(
    slant: f64,
    (height, width): (usize, usize),
    others: &[([f64; 3], [f64; 3])],
    test: impl FnOnce(&Setup<'_>),
) {
    let camera = PinholeCamera::from_fov(55.0, width, height).unwrap();
    let plane = [Plane::slanted(2.0, slant, 0.1)];
    let view = |(centre, angles)| render(&plane, camera, pose_at(centre, angles), 0.2);
    let (reference, depth) = view(([0.0; 3], [0.0; 3]));
    let others: Vec<PosedView> = others.iter().map(|place| view(*place).0).collect();
    let sources: Vec<&PosedView> = others.iter().collect();
    let centre: Vec<f32> = depth.iter().map(|z| z.recip()).collect();
    let multiples: Vec<f32> = (0..21).map(|k| 0.7 + 0.03 * k as f32).collect();
    test(&Setup { reference: &reference, sources: &sources, centre: &centre, multiples: &multiples });
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn costs_agree_with_the_definition(
        slant in -0.4..0.4_f64, dx in -0.3..0.3_f64, dy in -0.2..0.2_f64, dz in -0.3..0.3_f64,
        turn in -0.1..0.1_f64, size in (20..50_usize, 20..60_usize),
    ) {
        let moved = [([dx, dy, dz], [0.0, turn, 0.02]), ([-dy, dx, 0.0], [turn, 0.0, 0.0])];
        let others = [moved[0], moved[1], ([0.1, 0.0, 0.0], [0.0; 3])];
        with_setup(slant, size, &others, |setup| {
            let volume = Volume::new(setup);
            for (y, x) in (0..size.0).step_by(5).flat_map(|y| (0..size.1).step_by(7).map(move |x| (y, x))) {
                for (k, &multiple) in setup.multiples.iter().enumerate().step_by(3) {
                    let Some(exact) = reference_cost(setup, x, y, multiple) else { continue };
                    let found = f64::from(volume.costs[(y * size.1 + x) * 21 + k]) / f64::from(WORST);
                    assert!((found - exact).abs() < 5e-3, "{x} {y} {k}: {found} {exact}");
                }
            }
        });
    }
}

/// The processor's kernels differ in nothing but their speed.
#[test]
#[cfg(target_arch = "x86_64")]
fn costs_are_the_same_bytes_for_any_vector_width() {
    use pulp::Scalar;
    use pulp::x86::{V3, V4};
    let others = [([0.2, 0.0, 0.1], [0.0, 0.05, 0.02]), ([-0.1, 0.2, 0.0], [0.03, 0.0, 0.0])];
    with_setup(0.3, (53, 61), &others, |setup| {
        let reference = &Reference::new(setup.reference);
        let sources: &Vec<_> = &setup.sources.iter().map(|view| Source::new(setup.reference, view)).collect();
        let block = |top: usize, run: &dyn Fn(FillBlock<'_>)| {
            let mut slab = vec![0_u8; BLOCK.min(53 - top) * 61 * setup.multiples.len()];
            let scratch = &mut Scratch::new(reference, sources.len());
            run(FillBlock { setup, reference, sources, scratch, top, slab: &mut slab });
            slab
        };
        for top in [0, BLOCK] {
            let plain = block(top, &|block| Simd::vectorize(Scalar::new(), block));
            assert!(plain.iter().any(|cost| (1..254).contains(cost)));
            if let Some(simd) = V3::try_new() {
                assert_eq!(block(top, &|block| Simd::vectorize(simd, block)), plain);
            }
            if let Some(simd) = V4::try_new() {
                assert_eq!(block(top, &|block| Simd::vectorize(simd, block)), plain);
            }
        }
    });
}
