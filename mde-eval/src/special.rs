//! The error function and its inverse.

/// \\(\operatorname{erf}(x) = \frac{2}{\sqrt\pi} \int_0^x e^{-t^2}\\,\mathrm d t\\), to about one unit in the last place.
///
/// Cody, "Rational Chebyshev approximations for the error function" (Math. Comp. 23, 1969).
pub(crate) fn erf(x: f64) -> f64 {
    let magnitude = x.abs();
    if magnitude <= 0.468_75 {
        let square = x * x;
        return x * rational(&NEAR_TOP, &NEAR_BOTTOM, square);
    }
    let complement = if magnitude <= 4.0 {
        exp_of_minus_square(magnitude) * rational(&MIDDLE_TOP, &MIDDLE_BOTTOM, magnitude)
    } else if magnitude < 6.0 {
        let inverse = 1.0 / (magnitude * magnitude);
        let tail = inverse * rational(&FAR_TOP, &FAR_BOTTOM, inverse);
        exp_of_minus_square(magnitude) / magnitude * (FRAC_1_SQRT_PI - tail)
    } else {
        0.0
    };
    (1.0 - complement).copysign(x)
}

/// The half-width of the standard normal's central interval of probability `p` in (0, 1): \\(\operatorname{erf}(z / \sqrt2) = p\\).
pub(crate) fn central_half_width(p: f64) -> f64 {
    let (mut low, mut high) = (0.0, 9.0);
    // Bisection to the last bit: the function is flat where Newton's steps would leave the interval.
    for _ in 0..64 {
        let middle = 0.5 * (low + high);
        if erf(middle * std::f64::consts::FRAC_1_SQRT_2) < p { low = middle } else { high = middle }
    }
    high
}

pub(crate) const FRAC_1_SQRT_PI: f64 = 0.564_189_583_547_756_3;

/// \\(e^{-x^2}\\) with the square split, so that its rounding error is not raised to a power.
fn exp_of_minus_square(x: f64) -> f64 {
    let coarse = (x * 16.0).trunc() / 16.0;
    (-coarse * coarse).exp() * (-(x - coarse) * (x + coarse)).exp()
}

/// A quotient of polynomials, coefficients from the highest power down.
fn rational<const N: usize>(top: &[f64; N], bottom: &[f64; N], x: f64) -> f64 {
    let horner = |coefficients: &[f64; N]| coefficients.iter().fold(0.0, |sum, c| sum * x + c);
    horner(top) / horner(bottom)
}

const NEAR_TOP: [f64; 5] = [
    1.857_777_061_846_031_5e-1,
    3.161_123_743_870_565_6,
    1.138_641_541_510_501_6e2,
    3.774_852_376_853_02e2,
    3.209_377_589_138_469_5e3,
];
const NEAR_BOTTOM: [f64; 5] = [
    1.0,
    2.360_129_095_234_412_2e1,
    2.440_246_379_344_441_7e2,
    1.282_616_526_077_372_3e3,
    2.844_236_833_439_171e3,
];
const MIDDLE_TOP: [f64; 9] = [
    2.153_115_354_744_038_3e-8,
    5.641_884_969_886_701e-1,
    8.883_149_794_388_377,
    6.611_919_063_714_163e1,
    2.986_351_381_974_001e2,
    8.819_522_212_417_69e2,
    1.712_047_612_634_070_7e3,
    2.051_078_377_826_071_6e3,
    1.230_339_354_797_997_2e3,
];
const MIDDLE_BOTTOM: [f64; 9] = [
    1.0,
    1.574_492_611_070_983_3e1,
    1.176_939_508_913_125e2,
    5.371_811_018_620_099e2,
    1.621_389_574_566_690_3e3,
    3.290_799_235_733_459_7e3,
    4.362_619_090_143_247e3,
    3.439_367_674_143_721_6e3,
    1.230_339_354_803_749_5e3,
];
const FAR_TOP: [f64; 6] = [
    1.631_538_713_730_209_7e-2,
    3.053_266_349_612_323_6e-1,
    3.603_448_999_498_044_5e-1,
    1.257_817_261_112_292_6e-1,
    1.608_378_514_874_227_6e-2,
    6.587_491_615_298_378e-4,
];
const FAR_BOTTOM: [f64; 6] = [
    1.0,
    2.568_520_192_289_822,
    1.872_952_849_923_460_4,
    5.279_051_029_514_285e-1,
    6.051_834_131_244_132e-2,
    2.335_204_976_268_691_8e-3,
];

#[cfg(test)]
mod tests {
    use super::erf;

    /// From `scipy.special.erf`.
    #[test]
    fn it_is_the_error_function() {
        let reference = [
            (1e-9, 1.128_379_167_095_512_6e-9),
            (0.25, 0.276_326_390_168_236_96),
            (0.468_75, 0.492_613_473_217_938),
            (0.5, 0.520_499_877_813_046_5),
            (1.0, 0.842_700_792_949_714_9),
            (2.0, 0.995_322_265_018_952_7),
            (3.9, 0.999_999_965_207_751_4),
            (4.5, 0.999_999_999_803_384),
            (5.9, 1.0),
            (40.0, 1.0),
        ];
        for (x, expected) in reference {
            assert!((erf(x) - expected).abs() <= 3e-16 * (1.0_f64).max(expected), "erf({x}) = {}", erf(x));
            assert_eq!(erf(-x), -erf(x));
        }
    }

    #[test]
    fn the_interval_of_two_sigma() {
        // SciPy: norm.ppf(0.975), norm.ppf(0.95), norm.ppf(0.75).
        for (p, z) in [(0.95, 1.959963984540054_f64), (0.9, 1.6448536269514722), (0.5, 0.6744897501960817)] {
            assert!((super::central_half_width(p) - z).abs() < 1e-14);
        }
    }
}
