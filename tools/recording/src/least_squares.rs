//! The solution of systems of linear equations with a symmetric positive definite matrix, such as those of least squares.

/// Solves `matrix * x = right` by the Cholesky decomposition; `None` if the matrix is not positive definite, or if the solution
/// is not finite. Only the lower triangle of the matrix is used.
///
/// Source: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th edition, section 4.2.
pub fn solve<const N: usize>(matrix: [[f64; N]; N], right: [f64; N]) -> Option<[f64; N]> {
    let mut l = matrix;
    for i in 0..N {
        for j in 0..=i {
            let sum = l[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = if i > j { sum / l[j][j] } else { sum.sqrt() };
        }
        if !(l[i][i] > 0.0 && l[i][i].is_finite()) {
            return None;
        }
    }
    let mut x = right;
    for i in 0..N {
        x[i] = (x[i] - (0..i).map(|k| l[i][k] * x[k]).sum::<f64>()) / l[i][i];
    }
    for i in (0..N).rev() {
        x[i] = (x[i] - (i + 1..N).map(|k| l[k][i] * x[k]).sum::<f64>()) / l[i][i];
    }
    x.iter().all(|x| x.is_finite()).then_some(x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_solution_satisfies_the_equations_and_an_indefinite_matrix_has_none() {
        let matrix = [[4.0, 1.0, 0.5], [1.0, 3.0, -1.0], [0.5, -1.0, 2.0]];
        let x = solve(matrix, [1.0, -2.0, 3.0]).expect("positive definite");
        for (row, right) in matrix.iter().zip([1.0, -2.0, 3.0]) {
            let left: f64 = row.iter().zip(x).map(|(a, x)| a * x).sum();
            assert!((left - right).abs() < 1e-12, "{left} {right}");
        }
        assert_eq!(solve([[1.0, 2.0], [2.0, 1.0]], [1.0, 1.0]), None);
    }
}
