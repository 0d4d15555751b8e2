"""The public calls: arguments checked, an engine run, failures named."""
