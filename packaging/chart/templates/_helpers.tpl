{{- define "selector" -}}
app.kubernetes.io/name: {{ .Chart.Name }}
app.kubernetes.io/instance: {{ .Release.Name }}
{{- end }}

{{- define "labels" -}}
{{ include "selector" . }}
app.kubernetes.io/part-of: ros-diagnostics
app.kubernetes.io/version: {{ .Chart.AppVersion | quote }}
app.kubernetes.io/managed-by: {{ .Release.Service }}
helm.sh/chart: {{ .Chart.Name }}-{{ .Chart.Version }}
{{- end }}

{{- define "monitorLabels" -}}
{{ include "labels" . }}
{{- with .Values.monitorLabels }}
{{ toYaml . }}
{{- end }}
{{- end }}

{{- /* The two scrapes of prometheus/prometheus.yml, by job. */ -}}
{{- define "scrapes" -}}
ros-diagnostics-faults: {interval: 2s, params: {"collect[]": [faults]}}
ros-diagnostics: {interval: 15s, params: {"exclude[]": [faults]}}
{{- end }}

{{- /* With users or clients' certificates no probe can log in: whether the port answers is all that it sees. */ -}}
{{- define "probe" -}}
{{ if .root.Values.webConfig }}tcpSocket: {port: metrics}{{ else }}httpGet: {path: {{ .path }}, port: metrics}{{ end }}
{{- end }}
