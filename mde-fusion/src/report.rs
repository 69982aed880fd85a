use crate::Degenerate;

/// What a fusion estimated. `b` and `sigma_o` are in the prior's unit.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct FusionReport {
    /// Scale of Eq. 10; 1 where the calibration was refused.
    pub a: f64,
    /// Shift of Eq. 10; 0 where the calibration was refused.
    pub b: f64,
    /// The prior's standard deviation; the root of the mean variance over \\(\mathcal X\\) where it has its own.
    pub sigma_o: f64,
    /// \\(|\mathcal X|\\): pixels where neither the prior nor the views are missing.
    pub support: usize,
    /// Effective number of pixels of the affine fit.
    pub effective_support: f64,
    /// Weighted correlation of the views' depth with the prior's; 0 where undefined.
    pub correlation: f64,
    /// Mean over \\(\mathcal X\\) of the views' weight \\(w\\) in the result.
    pub nerf_weight: f64,
    /// Whether the estimate of \\(\sigma_o^2\\) was 0 or less, so that the views are ignored.
    pub sigma_o_clamped: bool,
    /// Why the calibration was refused, if it was.
    pub degenerate: Option<Degenerate>,
    /// Quantiles (5, 25, 50, 75, 95 %) of the views' aggregated variance, in the depth's unit squared; 0 without pixels.
    pub variance_quantiles: [f64; 5],
    /// Pixels whose fused depth was not positive and which kept the prior's.
    pub reverted: usize,
    /// Warnings that follow from the other fields.
    pub warnings: Vec<Warning>,
}

impl Default for FusionReport {
    fn default() -> Self {
        Self {
            a: 1.0,
            b: 0.0,
            sigma_o: 0.0,
            support: 0,
            effective_support: 0.0,
            correlation: 0.0,
            nerf_weight: 0.0,
            sigma_o_clamped: false,
            degenerate: None,
            variance_quantiles: [0.0; 5],
            reverted: 0,
            warnings: Vec::new(),
        }
    }
}

impl FusionReport {
    /// Fills [`warnings`](Self::warnings).
    pub(crate) fn collect_warnings(&mut self, bayes: bool) {
        let share = self.effective_support / self.support as f64;
        let found = [
            self.degenerate.map(|reason| Warning::Degenerate { reason }),
            (!(0.5..=2.0).contains(&self.a)).then_some(Warning::UnusualScale { a: self.a }),
            (share < 0.1).then_some(Warning::FewEffective { share }),
            (bayes && self.degenerate.is_none() && self.sigma_o == 0.0).then_some(Warning::PriorTakenAsExact),
            (self.reverted > 0).then_some(Warning::NotPositive { pixels: self.reverted }),
        ];
        self.warnings = found.into_iter().flatten().collect();
    }
}

/// An unusual result in a [`FusionReport`].
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "warning", rename_all = "kebab-case"))]
#[non_exhaustive]
pub enum Warning {
    /// The calibration was refused.
    #[error("no calibration: {reason}")]
    Degenerate {
        /// Why.
        reason: Degenerate,
    },
    /// A scale outside of 0.5 to 2, although the views were fitted in the prior's frame.
    #[error("the scale from the views to the prior is {a:.3}; noise in the views pulls it towards 0")]
    UnusualScale {
        /// The scale.
        a: f64,
    },
    /// The effective number of pixels of the affine fit is less than a tenth of the pixels.
    #[error("{:.1} % of the pixels have nearly all the weight in the affine fit", share * 100.0)]
    FewEffective {
        /// Effective pixels over all pixels.
        share: f64,
    },
    /// The prior's variance is 0, so the result is the prior.
    #[error("the prior's variance is estimated as 0, so the views are ignored; sigma is common-error only")]
    PriorTakenAsExact,
    /// Fused depths that were not positive.
    #[error("{pixels} fused depths were not positive; those pixels keep the prior's")]
    NotPositive {
        /// How many.
        pixels: usize,
    },
}
