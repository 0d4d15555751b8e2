"""Contact, joint limits and dry friction by impulses."""
