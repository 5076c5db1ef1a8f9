"""A page in the browser, on which a trained agent acts while its hidden task is changed."""
