// What the conjugate gradients know of each lane; this text stands before the kernels that read it.
struct Scalars {
    norm2: array<vec4<f32>, 4>,     // b · b
    target2: array<vec4<f32>, 4>,   // r · r at which a lane is done
    rr: array<vec4<f32>, 4>,        // r · r
    rz: array<vec4<f32>, 4>,        // r · z
    alpha: array<vec4<f32>, 4>,
    beta: array<vec4<f32>, 4>,
    live: array<vec4<f32>, 4>,      // 1 while a lane is worked on, else 0
    spent: array<vec4<f32>, 4>,     // iterations worked on the lane
    tolerance2: f32,                // of r · r, relative to b · b
    floor2: f32,                    // the same, relative to what a run began with
}
