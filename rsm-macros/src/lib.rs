//! include_model!: a coefficient file becomes a module of evaluators at compile time.
