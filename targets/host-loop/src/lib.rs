//! A periodic real-time loop on the host, with its report.
