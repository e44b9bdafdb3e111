"""Pictures of a run from its log: data (pure), figures, and the page that holds them."""
