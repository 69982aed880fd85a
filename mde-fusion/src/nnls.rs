/// Least pivot of a unit-diagonal Gram matrix that counts as independent.
const MIN_PIVOT: f64 = 1e-12;

/// Exact non-negative least squares in three unknowns.
///
/// \\[ \min_{c \ge 0} \tfrac12 c^{\mathsf T} G c - g^{\mathsf T} c,
/// \qquad G = A^{\mathsf T} A,\quad g = A^{\mathsf T} y \\]
///
/// Some minimiser is the unconstrained solution on its own support, with independent columns; so the best of the
/// non-negative solutions on all eight supports is a minimiser. `gram` is \\(G\\) (only its upper triangle is read),
/// `rhs` is \\(g\\). Columns of norm 0 get coefficient 0.
pub(crate) fn nnls3(gram: &[[f64; 3]; 3], rhs: [f64; 3]) -> [f64; 3] {
    // Unit columns: the unknowns may differ by many orders of magnitude.
    let norm = [gram[0][0].sqrt(), gram[1][1].sqrt(), gram[2][2].sqrt()];
    let mut g = [[0.0; 3]; 3];
    let mut y = [0.0; 3];
    for i in 0..3 {
        y[i] = rhs[i] / norm[i];
        for j in i..3 {
            g[i][j] = gram[i][j] / (norm[i] * norm[j]);
            g[j][i] = g[i][j];
        }
    }
    let mut best = [0.0; 3];
    let mut least = 0.0;
    for subset in 1..8_u8 {
        let support: Vec<usize> = (0..3).filter(|i| subset & (1 << i) != 0).collect();
        let Some(c) = solve(&g, y, &support) else { continue };
        let objective: f64 = support.iter().map(|&i| -0.5 * c[i] * y[i]).sum();
        if c.iter().all(|&c| c >= 0.0) && objective < least {
            (best, least) = (c, objective);
        }
    }
    let mut result = [0.0; 3];
    for i in 0..3 {
        let c = best[i] / norm[i];
        result[i] = if c.is_finite() { c } else { 0.0 };
    }
    result
}

/// The normal equations on `support` by Cholesky's factorisation; zero elsewhere, `None` where they are singular.
fn solve(gram: &[[f64; 3]; 3], rhs: [f64; 3], support: &[usize]) -> Option<[f64; 3]> {
    let n = support.len();
    let mut l = [[0.0; 3]; 3];
    let mut z = [0.0; 3];
    for (i, &p) in support.iter().enumerate() {
        for (j, &q) in support.iter().enumerate().take(i) {
            let dot: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = (gram[p][q] - dot) / l[j][j];
        }
        let pivot = gram[p][p] - l[i][..i].iter().map(|v| v * v).sum::<f64>();
        if pivot.is_nan() || pivot < MIN_PIVOT {
            return None;
        }
        l[i][i] = pivot.sqrt();
        let dot: f64 = (0..i).map(|k| l[i][k] * z[k]).sum();
        z[i] = (rhs[p] - dot) / l[i][i];
    }
    let mut c = [0.0; 3];
    for i in (0..n).rev() {
        let dot: f64 = (i + 1..n).map(|k| l[k][i] * c[support[k]]).sum();
        c[support[i]] = (z[i] - dot) / l[i][i];
    }
    Some(c)
}
