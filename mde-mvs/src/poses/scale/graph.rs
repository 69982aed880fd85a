//! The Laplacian of a sparse graph, factored, with the diagonal of its pseudo-inverse.
//!
//! \\( L = \sum_{ij} w_{ij} (e_i - e_j)(e_i - e_j)^\top \\) is factored as \\( U D U^\top \\) by eliminating nodes in the order of least degree, so a
//! chain with few loops takes time and memory in proportion to its length.

use std::collections::{BTreeMap, BTreeSet, HashMap};

/// The graph's Laplacian, factored: each node in turn is replaced by links between its neighbours.
pub(super) struct Laplacian {
    /// Nodes in the order of their elimination; the last of a component has no neighbour and the value 0.
    steps: Vec<Step>,
    /// Component of each node, numbered by the first in it.
    pub(super) components: Vec<usize>,
    /// Nodes of each component.
    pub(super) sizes: Vec<usize>,
}

struct Step {
    node: usize,
    /// Sum of the links' weights.
    total: f64,
    /// Neighbours that are eliminated later, with the share of each in that sum.
    shares: Vec<(usize, f64)>,
}

impl Laplacian {
    /// The graph of links between two nodes each, with their weights.
    pub(super) fn new(nodes: usize, edges: impl Iterator<Item = ([usize; 2], f64)>) -> Self {
        let mut links: Vec<BTreeMap<usize, f64>> = vec![BTreeMap::new(); nodes];
        for ([first, second], weight) in edges {
            *links[first].entry(second).or_default() += weight;
            *links[second].entry(first).or_default() += weight;
        }
        let mut queue: BTreeSet<_> = links.iter().enumerate().map(|(i, links)| (links.len(), i)).collect();
        let mut steps = Vec::with_capacity(nodes);
        while let Some((_, node)) = queue.pop_first() {
            let own = std::mem::take(&mut links[node]);
            let total: f64 = own.values().sum();
            let shares: Vec<(usize, f64)> = own.iter().map(|(&i, weight)| (i, weight / total)).collect();
            for (&i, weight) in &own {
                queue.remove(&(links[i].len(), i));
                links[i].remove(&node);
                for &(j, share) in shares.iter().filter(|(j, _)| *j != i) {
                    *links[i].entry(j).or_default() += weight * share;
                }
                queue.insert((links[i].len(), i));
            }
            steps.push(Step { node, total, shares });
        }
        // The last node of a component stands for all.
        let mut last: Vec<usize> = (0..nodes).collect();
        for step in steps.iter().rev() {
            last[step.node] = step.shares.first().map_or(step.node, |(later, _)| last[*later]);
        }
        let mut numbers = BTreeMap::new();
        let mut sizes = Vec::new();
        let number = |last: usize| {
            let number = *numbers.entry(last).or_insert(sizes.len());
            if number == sizes.len() {
                sizes.push(0);
            }
            sizes[number] += 1;
            number
        };
        let components = last.into_iter().map(number).collect();
        Self { steps, components, sizes }
    }

    /// Values of which the Laplacian is `right`, up to a constant for each component.
    pub(super) fn solve(&self, mut right: Vec<f64>) -> Vec<f64> {
        for step in &self.steps {
            let own = right[step.node];
            step.shares.iter().for_each(|(i, share)| right[*i] += share * own);
        }
        let mut values = vec![0.0; right.len()];
        for step in self.steps.iter().rev().filter(|step| !step.shares.is_empty()) {
            let beside: f64 = step.shares.iter().map(|(i, share)| share * values[*i]).sum();
            values[step.node] = right[step.node] / step.total + beside;
        }
        values
    }

    /// The same with a mean of 0 in each component.
    pub(super) fn centred(&self, mut values: Vec<f64>) -> Vec<f64> {
        let means = self.means(&values);
        values.iter_mut().zip(&self.components).for_each(|(value, component)| *value -= means[*component]);
        values
    }

    fn means(&self, values: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; self.sizes.len()];
        values.iter().zip(&self.components).for_each(|(value, component)| sums[*component] += value);
        sums.into_iter().zip(&self.sizes).map(|(sum, count)| sum / *count as f64).collect()
    }

    /// Variance of each value less the mean of its component: the diagonal of the Laplacian's pseudo-inverse.
    ///
    /// With the last node of each component held, the inverse \\( G \\) is found only where the factor has an entry
    /// (Takahashi, 1973); \\( \operatorname{var} (x_i - \bar x) = G_{ii} - 2 (G 1)_i / n + 1^\top G 1 / n^2 \\).
    pub(super) fn variances(&self) -> Vec<f64> {
        let count = self.components.len();
        let mut inverse: HashMap<[usize; 2], f64> = HashMap::new();
        for Step { node, total, shares } in self.steps.iter().rev().filter(|step| !step.shares.is_empty()) {
            let entry = |i: usize, j: usize| inverse.get(&[i, j]).copied().unwrap_or(0.0);
            let through = |i: usize| shares.iter().map(|&(j, share)| share * entry(j, i)).sum::<f64>();
            let own: Vec<(usize, f64)> = shares.iter().map(|&(i, _)| (i, through(i))).collect();
            let beside: f64 = shares.iter().zip(&own).map(|((_, share), (_, value))| share * value).sum();
            inverse.insert([*node, *node], 1.0 / total + beside);
            inverse.extend(own.iter().flat_map(|&(i, value)| [([*node, i], value), ([i, *node], value)]));
        }
        // 1 everywhere but at the node that is held, whose row of G is 0.
        let rows = self.solve(vec![1.0; count]);
        let means = self.means(&rows);
        let variance = |i: usize| {
            let size = self.sizes[self.components[i]] as f64;
            let own = inverse.get(&[i, i]).copied().unwrap_or(0.0);
            own - 2.0 * rows[i] / size + means[self.components[i]] / size
        };
        (0..count).map(variance).collect()
    }
}
