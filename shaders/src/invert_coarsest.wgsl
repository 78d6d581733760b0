// The dense inverse of the coarsest level's matrix, at most 64 rows, by Gauss–Jordan without
// pivoting, which is stable for a symmetric positive definite matrix. One workgroup, an invocation
// for each column.
// Twin: invert in diffusion/src/cpu/level.rs.

@group(1) @binding(0) var<storage, read_write> inverse: array<f32>;

const ROWS: u32 = 64u;

var<workgroup> a: array<f32, ROWS * ROWS>;

@compute @workgroup_size(ROWS)
fn invert_coarsest(@builtin(local_invocation_index) j: u32) {
    let size = level.cells.x * level.cells.y * level.cells.z;
    let place = vec3(j % level.cells.x, j / level.cells.x % level.cells.y,
        j / (level.cells.x * level.cells.y));
    for (var i = 0u; i < ROWS; i++) {
        a[i * ROWS + j] = 0.0;
    }
    if j < size {
        let low = faces_below(place);
        let high = faces_above(place);
        a[j * ROWS + j] = absorption[j] + face_x[low.x] + face_x[high.x] + face_y[low.y]
            + face_y[high.y] + face_z[low.z] + face_z[high.z];
        // Column j: what its six neighbours take from it.
        let step = vec3(1u, level.cells.x, level.cells.x * level.cells.y);
        if place.x > 0u {
            a[(j - step.x) * ROWS + j] = -face_x[low.x];
        }
        if place.x + 1u < level.cells.x {
            a[(j + step.x) * ROWS + j] = -face_x[high.x];
        }
        if place.y > 0u {
            a[(j - step.y) * ROWS + j] = -face_y[low.y];
        }
        if place.y + 1u < level.cells.y {
            a[(j + step.y) * ROWS + j] = -face_y[high.y];
        }
        if place.z > 0u {
            a[(j - step.z) * ROWS + j] = -face_z[low.z];
        }
        if place.z + 1u < level.cells.z {
            a[(j + step.z) * ROWS + j] = -face_z[high.z];
        }
    }
    for (var k = 0u; k < size; k++) {
        workgroupBarrier();
        let pivot = 1.0 / a[k * ROWS + k];
        if j != k {
            let own = a[k * ROWS + j] * pivot;
            for (var i = 0u; i < size; i++) {
                if i != k {
                    a[i * ROWS + j] -= a[i * ROWS + k] * own;
                }
            }
            a[k * ROWS + j] = own;
        }
        // Column k was read by all the others and is overwritten last.
        workgroupBarrier();
        if j == k {
            for (var i = 0u; i < size; i++) {
                a[i * ROWS + k] *= -pivot;
            }
            a[k * ROWS + k] = pivot;
        }
    }
    if j < size {
        for (var i = 0u; i < size; i++) {
            inverse[i * size + j] = a[i * ROWS + j];
        }
    }
}
