//! From measured data to a model: records, designs, least squares, selection, statistics.
