//! Real roots of polynomials of low degree.

use nalgebra::Complex;

/// Newton steps that polish a root found in closed form.
const POLISH: usize = 3;
/// An imaginary part below this share of the root's size is rounding.
const IMAGINARY: f64 = 1e-6;

fn evaluate(a: &[f64], x: f64) -> (f64, f64) {
    a.iter().rev().fold((0.0, 0.0), |(value, slope), c| (value * x + c, slope * x + value))
}

/// Real roots of \\( a_n x^n + \dots + a_0 \\), coefficients from the constant up; a degree lower where the leading coefficient is zero.
pub(super) fn real_roots<const N: usize>(a: [f64; N]) -> Vec<f64> {
    complex_roots(&a)
        .into_iter()
        .filter(|r| r.im.abs() <= IMAGINARY.sqrt() * (1.0 + r.re.abs()))
        .map(|r| {
            (0..POLISH).fold(r.re, |x, _| {
                let (value, slope) = evaluate(&a, x);
                let step = value / slope;
                if step.is_finite() { x - step } else { x }
            })
        })
        .filter(|&x| {
            let size: f64 = a.iter().rev().fold(0.0, |sum, c| sum * x.abs() + c.abs());
            x.is_finite() && evaluate(&a, x).0.abs() <= IMAGINARY * size
        })
        .collect()
}

/// All roots by Durand and Kerner's simultaneous iteration, which no start of distinct points makes fail but for a set of measure zero.
fn complex_roots(a: &[f64]) -> Vec<Complex<f64>> {
    let largest = a.iter().fold(0.0, |m: f64, c| m.max(c.abs()));
    let degree = a.iter().rposition(|c| c.abs() > 1e-14 * largest);
    let Some(degree) = degree.filter(|_| largest.is_finite()) else { return Vec::new() };
    let monic: Vec<f64> = a[..=degree].iter().map(|c| c / a[degree]).collect();
    let bound = 1.0 + monic[..degree].iter().fold(0.0, |m: f64, c| m.max(c.abs()));
    // Fujiwara's bound is closer to the roots than Cauchy's where coefficients differ much.
    let radii = (0..degree).map(|i| monic[i].abs().powf(1.0 / (degree - i) as f64));
    let radius = radii.fold(0.0, f64::max).clamp(1e-12, bound);
    let mut roots: Vec<Complex<f64>> = (0..degree)
        .map(|k| Complex::from_polar(radius, 0.7 + std::f64::consts::TAU * k as f64 / degree as f64))
        .collect();
    for _ in 0..60 {
        let mut moved = 0.0_f64;
        for i in 0..degree {
            let x = roots[i];
            let value = monic.iter().rev().fold(Complex::new(0.0, 0.0), |sum, c| sum * x + c);
            let others = (0..degree).filter(|&j| j != i);
            let apart = others.fold(Complex::new(1.0, 0.0), |product, j| product * (x - roots[j]));
            let step = value / apart;
            if step.re.is_finite() && step.im.is_finite() {
                roots[i] -= step;
                moved = moved.max(step.norm() / (1.0 + x.norm()));
            }
        }
        if moved < 1e-13 {
            break;
        }
    }
    roots
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn lower_degrees_and_none() {
        assert!((real_roots([-6.0, 2.0, 0.0, 0.0])[0] - 3.0).abs() < 1e-12);
        assert!(real_roots([1.0, 0.0, 1.0, 0.0]).is_empty());
        assert!(real_roots([0.0; 4]).is_empty() && real_roots([f64::NAN; 5]).is_empty());
    }

    proptest! {
        /// The roots of a product of linear factors, and no other, are found.
        #[test]
        fn separate_real_roots_are_found(start in -5.0..5.0_f64, gaps in [0.05..3.0_f64, 0.05..3.0, 0.05..3.0], lead in 0.1..10.0_f64) {
            let roots = [start, start + gaps[0], start + gaps[0] + gaps[1], start + gaps.iter().sum::<f64>()];
            let mut a = vec![lead];
            for root in roots {
                let mut next = vec![0.0; a.len() + 1];
                for (i, c) in a.iter().enumerate() {
                    next[i + 1] += c;
                    next[i] -= root * c;
                }
                a = next;
            }
            let mut found = real_roots([a[0], a[1], a[2], a[3], a[4]]);
            found.sort_by(f64::total_cmp);
            prop_assert_eq!(found.len(), 4);
            for (f, r) in found.iter().zip(roots) {
                prop_assert!((f - r).abs() < 1e-5, "{} {}", f, r);
            }
        }

        /// A quartic that is positive everywhere has no real root; its product with a linear factor has one.
        #[test]
        fn complex_pairs_are_left_out(b in -3.0..3.0_f64, c in 0.2..4.0_f64, root in -4.0..4.0_f64) {
            let square = [b * b / 4.0 + c, b, 1.0];
            prop_assert!(real_roots([square[0], square[1], square[2], 0.0, 0.0]).is_empty());
            let times = [-root * square[0], square[0] - root * square[1], square[1] - root, 1.0];
            let found = real_roots(times);
            prop_assert_eq!(found.len(), 1);
            prop_assert!((found[0] - root).abs() < 1e-7);
        }
    }
}
