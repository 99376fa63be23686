"""Reports for people and programs: documents (JSON), flat (CSV), table (terminal), page (one HTML page a session).

Only the documents are loaded with the package: a batch that writes JSON needs neither rich nor the page.
"""

from inhalemon.report.documents import error_to_dict, from_dict, to_dict, to_json

__all__ = ["error_to_dict", "from_dict", "to_dict", "to_json"]
