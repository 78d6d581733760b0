// The scalars of the conjugate gradients: adds up what the workgroups left, and works out what
// depends on it. One workgroup; an entry point for each place of the iteration.
// Twin: Krylov::run in diffusion/src/cpu/pcg.rs.

@group(1) @binding(1) var<storage, read_write> scalars: Scalars;

@compute @workgroup_size(THREADS)
fn measure(@builtin(local_invocation_index) q: u32) {
    let sum = total(q, level.quads);
    if q < level.quads {
        scalars.norm2[q] = sum;
        scalars.spent[q] = vec4(0.0);
    }
}

@compute @workgroup_size(THREADS)
fn begin(@builtin(local_invocation_index) q: u32) {
    let sum = total(q, level.quads);
    if q < level.quads {
        let goal = max(scalars.tolerance2 * scalars.norm2[q], scalars.floor2 * sum);
        scalars.target2[q] = goal;
        scalars.rr[q] = sum;
        scalars.rz[q] = vec4(0.0);
        scalars.live[q] = select(vec4(0.0), vec4(1.0), sum > goal);
    }
}

@compute @workgroup_size(THREADS)
fn beta(@builtin(local_invocation_index) q: u32) {
    let sum = total(q, level.quads);
    if q < level.quads {
        let old = scalars.rz[q];
        let going = scalars.live[q] > vec4(0.0) & old > vec4(0.0);
        scalars.beta[q] = select(vec4(0.0), sum / old, going);
        scalars.rz[q] = sum;
    }
}

@compute @workgroup_size(THREADS)
fn alpha(@builtin(local_invocation_index) q: u32) {
    let sum = total(q, level.quads);
    if q < level.quads {
        let going = scalars.live[q] > vec4(0.0) & sum > vec4(0.0);
        scalars.alpha[q] = select(vec4(0.0), scalars.rz[q] / sum, going);
    }
}

@compute @workgroup_size(THREADS)
fn settle(@builtin(local_invocation_index) q: u32) {
    let sum = total(q, level.quads);
    if q < level.quads {
        scalars.rr[q] = sum;
        scalars.spent[q] += scalars.live[q];
        let going = scalars.live[q] > vec4(0.0) & sum > scalars.target2[q] & scalars.alpha[q] > vec4(0.0);
        scalars.live[q] = select(vec4(0.0), vec4(1.0), going);
    }
}
