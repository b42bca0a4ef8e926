//! Images of a box in growing blocks, and few points that stand for many of them.
//!
//! A block holds the images n with |n_k| ≤ R_k along each periodic axis. The next one is three times as large, 2 R' + 1 =
//! 3 (2 R + 1), and consists of as many blocks as there are neighbours. Seen from the box, which is small beside them, all
//! images of such a block act as few would do: the nodes of the quadrature that Σ_n f(n) has for polynomials f.

/// An image, by how many periods along each axis, and how many it stands for.
pub(super) type Image = ([f64; 3], f64);

/// The images within a block.
pub(super) fn within(reach: [usize; 3]) -> Vec<[f64; 3]> {
    let range = |k: usize| -(reach[k] as i64)..=reach[k] as i64;
    let mut images = Vec::new();
    for x in range(0) {
        for y in range(1) {
            images.extend(range(2).map(|z| [x, y, z].map(|n| n as f64)));
        }
    }
    images
}

/// The reach of the next block along the axes that are periodic.
pub(super) fn next(reach: [usize; 3], is_periodic: [bool; 3]) -> [usize; 3] {
    std::array::from_fn(|k| if is_periodic[k] { 3 * reach[k] + 1 } else { 0 })
}

/// What is in the next block and not in that of `reach`, by at most `nodes` points along each axis of a block.
pub(super) fn shell(reach: [usize; 3], is_periodic: [bool; 3], nodes: usize) -> Vec<Image> {
    let rules: [Vec<(f64, f64)>; 3] = std::array::from_fn(|k| {
        let edge = 2 * reach[k] + 1;
        let own = counting_rule(edge, nodes);
        if !is_periodic[k] {
            return vec![(0.0, 1.0)];
        }
        let sides = [-1.0, 0.0, 1.0];
        sides
            .iter()
            .flat_map(|side| own.iter().map(move |(n, w)| (n + side * edge as f64, *w)))
            .collect()
    });
    let mut images = Vec::new();
    for x in &rules[0] {
        for y in &rules[1] {
            for z in &rules[2] {
                let n = [x.0, y.0, z.0];
                let is_inside = (0..3).all(|k| n[k].abs() < reach[k] as f64 + 0.5);
                if !is_inside {
                    images.push((n, x.1 * y.1 * z.1));
                }
            }
        }
    }
    images
}

/// Nodes and weights with Σ_i w_i f(x_i) = Σ_n f(n), n = −(count − 1)/2 … (count − 1)/2, for all polynomials f of a degree
/// below 2 `nodes`, or all n if there are no more.
///
/// The orthogonal polynomials are those of Gram, p_{k+1} = x p_k − β_k p_{k−1} with β_k = k² (count² − k²) / (4 (4 k² − 1)).
pub(super) fn counting_rule(count: usize, nodes: usize) -> Vec<(f64, f64)> {
    let middle = 0.5 * (count as f64 - 1.0);
    if count <= nodes {
        return (0..count).map(|n| (n as f64 - middle, 1.0)).collect();
    }
    // In units of half the interval, in which no number is large.
    let half = 0.5 * count as f64;
    let beta = |k: usize| {
        let (k, count) = ((k * k) as f64, (count * count) as f64);
        k * (count - k) / (4.0 * (4.0 * k - 1.0)) / (half * half)
    };
    let polynomial = |degree: usize, x: f64| {
        let (mut previous, mut current) = (0.0, 1.0);
        for k in 0..degree {
            let next = x * current - if k > 0 { beta(k) * previous } else { 0.0 };
            (previous, current) = (current, next);
        }
        current
    };
    // Between two roots of one polynomial, and outside them, lies a root of the next.
    let mut roots: Vec<f64> = Vec::new();
    for degree in 1..=nodes {
        let ends: Vec<f64> = [-1.0].into_iter().chain(roots).chain([1.0]).collect();
        let root = |ends: &[f64]| bisected(ends[0], ends[1], |x| polynomial(degree, x));
        roots = ends.windows(2).map(root).collect();
    }
    let weight = |x: f64| {
        let (mut norm, mut sum) = (count as f64, 0.0);
        for k in 0..nodes {
            norm *= if k > 0 { beta(k) } else { 1.0 };
            sum += polynomial(k, x).powi(2) / norm;
        }
        1.0 / sum
    };
    roots.into_iter().map(|x| (x * half, weight(x))).collect()
}

/// The root of a function that changes its sign between two numbers.
fn bisected(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let rises = f(high) > 0.0;
    loop {
        let middle = 0.5 * (low + high);
        if middle <= low || middle >= high {
            return middle;
        }
        if (f(middle) > 0.0) == rises { high = middle } else { low = middle }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_nodes_stand_for_many_images() {
        for (count, nodes) in [(9, 12), (27, 5), (81, 12), (6561, 11)] {
            let rule = counting_rule(count, nodes);
            assert_eq!(rule.len(), count.min(nodes));
            let half = 0.5 * count as f64;
            for degree in 0..2 * nodes as i32 {
                let found: f64 = rule.iter().map(|(x, w)| w * (x / half).powi(degree)).sum();
                let middle = 0.5 * (count as f64 - 1.0);
                let exact: f64 =
                    (0..count).map(|n| ((n as f64 - middle) / half).powi(degree)).sum();
                assert!(
                    (found - exact).abs() < 1e-11 * count as f64,
                    "{count} {degree}: {found} {exact}"
                );
            }
        }
    }

    #[test]
    fn shells_fill_blocks() {
        let periodic = [true, false, true];
        let (inner, outer) = ([1, 0, 2], next([1, 0, 2], periodic));
        assert_eq!(outer, [4, 0, 7]);
        let shell = shell(inner, periodic, 9);
        let count: f64 = shell.iter().map(|(_, w)| w).sum();
        assert!((count - (within(outer).len() - within(inner).len()) as f64).abs() < 1e-9);
        assert!(shell.iter().all(|(n, _)| n[0].abs() > 1.5 || n[2].abs() > 2.5));
    }
}
